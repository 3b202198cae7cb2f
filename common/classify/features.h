// What the classifier sees of a pixel: colour and texture at several scales, and the start mesh as the pixel sees it.
#ifndef TESSERA_COMMON_CLASSIFY_FEATURES_H_
#define TESSERA_COMMON_CLASSIFY_FEATURES_H_

#include <memory>
#include <string>
#include <vector>

#include "common/classify/mesh_surface.h"
#include "common/classify/places.h"
#include "common/imaging/raster.h"
#include "common/scene/scene.h"

namespace tessera {

// Names of the features in their order: first those of appearance, then those of the mesh. Part of a model's identity.
const std::vector<std::string>& FeatureNames();
int AppearanceFeatureCount();
int FeatureCount();

// Planes of one image, from which the features of any of its pixels follow. Features are of the image's own (distorted)
// frame. About 60 bytes a pixel. Const member functions may be called from any thread at once.
class ImageFeatures {
 public:
  // `rgb` of the size of view.lens.pinhole, grey or colour; `surface` null: the features of the mesh are those of a
  // pixel that sees none. `up` is unit, in the frame of view.camera.
  ImageFeatures(const ByteImage& rgb, const SceneView& view, const Eigen::Vector3d& up, const MeshSurface* surface);
  ~ImageFeatures();
  ImageFeatures(ImageFeatures&&) noexcept;
  ImageFeatures& operator=(ImageFeatures&&) noexcept;

  int width() const;
  int height() const;
  // Features of `count` pixels from (x, y) on in a row: feature f of pixel i in out[f * stride + i].
  void Row(int x, int y, int count, int stride, float* out) const;
  // Where the pixel looks; `view`: the image's number, for those that meet no surface.
  PixelPlace PlaceOf(int x, int y, uint32_t view) const;

 private:
  struct Planes;
  std::unique_ptr<Planes> planes_;
};

// Undistorted position of a pixel position of the distorted image (the inverse of LensModel::Distort, by iteration).
Eigen::Vector2d UndistortPosition(const LensModel& lens, const Eigen::Vector2d& distorted);

}  // namespace tessera

#endif  // TESSERA_COMMON_CLASSIFY_FEATURES_H_
