// E_photo: 1 - ZNCC over windows of all view pairs, its exact gradient and Gauss-Newton curvature at the vertices
// (Bláha et al. 2017, eq. 2-4, with the derivative of the windowed score instead of the pointwise one).
#ifndef TESSERA_WORKER_REFINE_PHOTO_TERM_H_
#define TESSERA_WORKER_REFINE_PHOTO_TERM_H_

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "common/base/clock.h"
#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"
#include "common/imaging/raster.h"
#include "worker/refine/pairs.h"
#include "worker/refine/zncc_kernel.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {

// A view at one pyramid level, cut to what the mesh can cover. `luminance` has the camera's size, NaN where invalid.
struct PhotoView {
  PosedCamera camera;
  PaddedPlane luminance;
};

PaddedPlane ToPaddedPlane(const FloatImage& image);

struct PhotoOptions {
  ZnccWindow window;
  double min_cosine = 0.1;  // of the angle between a face's normal and the ray
  double occlusion_px = 6;  // slack of the depth test, in pixels of the other view
};

// Sums over windows and their derivatives. A vertex's entries are the sum over pairs divided by the mean number of
// pairs that see its faces.
struct PhotoDerivatives {
  ZnccSums sums;
  std::vector<Eigen::Vector3d> gradient;   // per metre
  std::vector<Eigen::Matrix3d> curvature;  // per metre²; positive semidefinite, upper bound of Gauss-Newton's
  std::vector<float> pairs;  // mean number of accepted pairs on the vertex's faces; 0: no view pair sees it
  int64_t warped_pixels = 0;
  double seconds_visibility = 0, seconds_photo = 0;
};

// One window's weights: Gaussian of sigma = size / 4, or box.
ZnccWindow MakeWindow(int size_px, bool gaussian);

// Evaluates all pairs on a mesh. Holds buffers between calls. Results do not depend on the number of threads.
class PhotoTerm {
 public:
  // `views` and `pairs` must outlive this; pairs sorted by reference.
  PhotoTerm(const std::vector<PhotoView>& views, const std::vector<ViewPair>& pairs, const PhotoOptions& options);

  // Visibility is taken from `mesh` and `occluders` as they are and frozen in the derivatives. `clock` may be null.
  void Evaluate(const TriangleMesh& mesh, const TriangleMesh& occluders, const Clock* clock, PhotoDerivatives* out);

 private:
  // Scalars a face corner: derivative, curvature; and a face: pairs.
  struct FaceSums {
    std::array<float, 3> gradient = {0, 0, 0};
    std::array<float, 3> curvature = {0, 0, 0};
    float pairs = 0;
  };
  void PrepareReference(const TriangleMesh& mesh, const std::vector<Eigen::Vector3d>& normals, int view);
  void GatherFaces(const TriangleMesh& mesh, int view);
  void GatherVertices(const TriangleMesh& mesh, const std::vector<Eigen::Vector3d>& normals, PhotoDerivatives* out);

  const std::vector<PhotoView>& views_;
  const std::vector<ViewPair>& pairs_;
  PhotoOptions options_;
  std::vector<FaceMap> maps_;
  PaddedPlane depth_, depth_factor_, gradient_, curvature_, count_;
  std::vector<uint8_t> used_faces_;  // of the reference at hand: 1 where a pixel is used
  std::vector<FaceSums> face_sums_;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_PHOTO_TERM_H_
