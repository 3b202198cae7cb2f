// The data terms on one level of the pyramid: the views' texels, and what they say of each face as the mesh lies.
#ifndef TESSERA_WORKER_PHOTO_DATA_TERM_H_
#define TESSERA_WORKER_PHOTO_DATA_TERM_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/imaging/border_trust.h"
#include "common/imaging/camera.h"
#include "common/imaging/raster.h"
#include "worker/photo/contour_term.h"
#include "worker/photo/pairs.h"
#include "worker/photo/photo_term.h"
#include "worker/photo/view_pixels.h"
#include "worker/photo/warp_target.h"
#include "worker/visibility/mesh_cells.h"
#include "worker/visibility/view_groups.h"

namespace tessera {

struct RefineView {
  PosedCamera camera;                        // of the whole image
  std::shared_ptr<const ViewPixels> pixels;  // of part of it
  bool asks_likelihoods = true;              // where the options do and the pixels have them
  DepthRange depths = {};                    // of all that the job looks at in the view; empty: of the mesh as it lies
  int32_t id = 0;                            // the view's number in the job
};

struct DataOptions {
  // Windowed ZNCC.
  int window_px = 7;            // odd, 3..11
  bool gaussian_window = true;  // sigma = window_px / 4; else a box
  double noise_sigma = 0.01;    // of luminance: a reference window of variance v weighs v / (v + sigma²)
  double min_sigma = 0.004;     // windows of less standard deviation in either image are rejected
  double max_mean_difference = 0.3;
  double max_variance_ratio = 10;
  double min_valid = 0.5;      // share of a window that both images must see
  double min_cosine = 0.1;     // flatter views of a face than this are skipped
  double occlusion_px = 1;     // slack of the depth test, in pixels of the level
  double photo_outlier = 0.5;  // s: a window's e = 1 - ZNCC counts e / (1 + e/s)

  double semantic = 0;   // λ1, of E_sem; 0: off
  double contour = 0;    // λ4, of E_contour; 0: off
  BorderTrusts borders;  // of the views' likelihoods
};

// What the pixels say of each face, all views together.
struct FaceDerivatives {
  PhotoSums photo;
  ContourSums contours;
};

// How far from a pixel of level 0 lies what its derivatives read in the same view, when the coarsest level is `level`:
// two windows' radii, and what a coarse pixel is made of. Where it lands in another view, a cell of bilinear
// interpolation. Pixels of level 0.
int ReferenceMargin_px(int window_px, int level);
int TargetMargin_px(int level);

class DataTerm {
 public:
  // What is passed must outlive it, but for the options; `cells` may be null.
  DataTerm(const std::vector<RefineView>& views, const std::vector<ViewPair>& pairs, const ViewGroups& groups,
           const MeshCells* cells, const DataOptions& options);

  // Errors as those of ViewPixels.
  Status EnterLevel(int level);

  // At the mesh as it lies, on the level at hand; `mesh.labels` empty: no contours. Exact for own faces (flags; empty:
  // all), to the last bit, wherever the mesh has all faces that the margins above can show: see PhotoTerm::Evaluate.
  void Evaluate(const TriangleMesh& mesh, const std::vector<uint8_t>& own, const Clock* clock, FaceDerivatives* out);

  // Gives back what the next Evaluate would use again.
  void ReleaseBuffers() { photo_->ReleaseBuffers(); }

 private:
  const std::vector<RefineView>& problem_views_;
  const std::vector<ViewPair>& pairs_;
  const ViewGroups& groups_;
  const MeshCells* cells_;
  const DataOptions options_;
  std::vector<PhotoView> views_;
  std::unique_ptr<PhotoTerm> photo_;
  int level_ = -1;
};

// The data term's share of the options.
PhotoOptions MakePhotoOptions(const DataOptions& options);

}  // namespace tessera

#endif  // TESSERA_WORKER_PHOTO_DATA_TERM_H_
