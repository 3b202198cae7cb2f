// Classifier features of a pixel: colour and texture at several scales, and the start mesh along the pixel's ray.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "common/classify/mesh_surface.h"
#include "common/classify/spatial_folds.h"
#include "common/imaging/raster.h"
#include "common/scene/scene.h"

namespace tessera {

// Names of the features in order: first the appearance features, then the mesh features. Models store these names.
const std::vector<std::string>& FeatureNames();
int AppearanceFeatureCount();
int FeatureCount();

// Feature planes of one (distorted) image; about 60 bytes per pixel. Const member functions are thread-safe.
class ImageFeatures {
 public:
  // `rgb`: grey or colour, of the size of view.lens.pinhole. `surface` null: all mesh features are 0. `up`: unit vector
  // in the world frame of view.camera.
  ImageFeatures(const ByteImage& rgb, const SceneView& view, const Eigen::Vector3d& up, const MeshSurface* surface);
  ~ImageFeatures();

  int width() const;
  int height() const;
  // Writes the features of `count` pixels of row y, starting at x: feature f of pixel i to out[f * stride + i].
  void Row(int x, int y, int count, int stride, float* out) const;
  // The location for spatial folds. `view`: the image's index, used for pixels whose ray hits no surface.
  PixelLocation LocationOf(int x, int y, uint32_t view) const;

 private:
  struct Planes;
  std::unique_ptr<Planes> planes_;
};

}  // namespace tessera
