// The data terms at one pyramid level: loads the views' texels and evaluates E_photo, E_sem and E_contour per face.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/imaging/border_trust.h"
#include "common/imaging/camera.h"
#include "common/imaging/raster.h"
#include "common/job/refine_steps.h"
#include "worker/photo/contour_term.h"
#include "worker/photo/pairs.h"
#include "worker/photo/photo_term.h"
#include "worker/photo/stored_texels.h"
#include "worker/photo/warp_target.h"
#include "worker/visibility/mesh_cells.h"
#include "worker/visibility/view_groups.h"

namespace tessera {

struct RefineView {
  PosedCamera camera;                        // of the whole image
  std::shared_ptr<const ViewPixels> pixels;  // part of the image
  DepthRange depths = {};  // of all surfaces the job matches in this view; empty: derived from the mesh
  int32_t id = 0;          // the view's id in the job
  int index = 0;           // in the tile's package

  CameraWindow window() const { return {camera, pixels->rect()}; }
};

struct DataOptions {
  int window_px = 7;            // odd, 3..11
  bool gaussian_window = true;  // sigma = window_px / 4; else a box
  PhotoOptions photo;           // but for the size and the weights of the window, and the weight of E_sem
  double semantic = 0;          // λ1, weight of E_sem; 0: off
  double contour = 0;           // λ4, weight of E_contour; 0: off
  BorderTrusts borders;         // of the views' likelihoods
};

// Derivatives of the data terms per face, summed over all views.
struct FaceDerivatives {
  PhotoSums photo;
  ContourSums contours;
};

// Margins in pixels of level 0 when the coarsest level is `level`. ReferenceMargin_px: the derivatives of a pixel
// read pixels of the same view up to this far away (two window radii plus the footprint of a coarse pixel).
// TargetMargin_px: the same where it is warped into another view (a cell of bilinear interpolation).
int ReferenceMargin_px(int window_px, int level);
int TargetMargin_px(int level);

class DataTerm {
 public:
  // `views`, in the order of the job, `groups` and `cells` must outlive the object; `cells` may be null.
  // `uses_likelihoods` false: E_sem and E_contour are off.
  DataTerm(const std::vector<RefineView>& views, const std::vector<ViewPair>& pairs, const ViewGroups& groups,
           const MeshCells* cells, bool uses_likelihoods, const DataOptions& options);

  // Errors as ViewPixels.
  Status EnterLevel(int level);

  // Evaluates the terms at the mesh's current positions on the current level. Without `mesh.labels` there are no
  // contours. The derivatives of own faces (flags; empty: all) are exact to the last bit if the mesh contains all
  // faces that the margins above can show: see PhotoTerm::Evaluate.
  void Evaluate(const TriangleMesh& mesh, const std::vector<uint8_t>& own, PairDirections directions,
                const Clock* clock, FaceDerivatives* out);

  // Frees the buffers that the next Evaluate would use again.
  void ReleaseBuffers() {
    if (photo_) photo_->ReleaseBuffers();
  }

 private:
  std::vector<ViewPair>& PairsIn(PairDirections directions) { return pairs_[static_cast<size_t>(directions)]; }

  const std::vector<RefineView>& refine_views_;
  std::array<std::vector<ViewPair>, 3> pairs_;  // by PairDirections
  const ViewGroups& groups_;
  const MeshCells* cells_;
  const bool uses_likelihoods_;
  const DataOptions options_;
  std::vector<PhotoView> views_;
  std::unique_ptr<PhotoTerm> photo_;
  int level_ = -1;
};

}  // namespace tessera
