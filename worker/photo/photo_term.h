// The data term E_photo + λ1 E_sem of all view pairs: 1 - ZNCC over windows, and half the squared differences of class
// likelihoods pixel by pixel; exact gradient and Gauss-Newton curvature at the vertices (Bláha et al. 2017, eq. 2-5,
// with the derivative of the windowed score instead of the pointwise one).
#ifndef TESSERA_WORKER_PHOTO_PHOTO_TERM_H_
#define TESSERA_WORKER_PHOTO_PHOTO_TERM_H_

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"
#include "worker/photo/face_sums.h"
#include "worker/photo/pairs.h"
#include "worker/photo/stored_texels.h"
#include "worker/photo/texels.h"
#include "worker/photo/warp_target.h"
#include "worker/photo/zncc_kernel.h"
#include "worker/visibility/rasterizer.h"
#include "worker/visibility/view_groups.h"

namespace tessera {

// A view at one pyramid level: the whole image's camera (its pixels may count from anywhere, the width and height mean
// nothing) and the texels of what the mesh can cover of it, or where they are brought from while the view is open.
struct PhotoView {
  // Sums are made in strips and blocks that count from the window's corner: where it is a multiple of this in both
  // directions, a face that a window holds with its surroundings has the same sums, bit for bit, in any other.
  static constexpr int kWindowStep = 64;

  PosedCamera camera;
  Texels texels;
  DepthRange depths = {};  // empty: taken anew from what the view sees, so that it depends on all of the mesh
  std::optional<StoredTexels> stored = std::nullopt;
  int step_x = 0, step_y = 0;  // where some step of the windows on `stored` begins

  // With its corner moved to the step before it.
  PixelRect FromStep(const PixelRect& rect) const {
    const auto before = [](int x, int step) { return x - ((x - step) % kWindowStep + kWindowStep) % kWindowStep; };
    return {before(rect.x0, step_x), before(rect.y0, step_y), rect.x1, rect.y1};
  }
  // The window on all that there is.
  PixelRect rect() const {
    if (stored) return FromStep(stored->rect);
    return {texels.x0, texels.y0, texels.x0 + texels.width, texels.y0 + texels.height};
  }
};

struct PhotoOptions {
  ZnccWindow window;
  SemanticWeight semantic;    // pairs of which a view has no likelihoods have no E_sem
  double min_cosine = 0.1;    // of the angle between a face's normal and the ray
  double occlusion_px = 1;    // slack of the depth test, in pixels of the other view
  int visitor_margin_px = 0;  // that a visitor reads about own faces' pixels
};

// What the pixels say of each face, all views together.
struct PhotoSums {
  ZnccSums sums;                // over windows and pixels
  std::vector<FaceSums> faces;  // derivatives of energy + λ1 semantic_energy; of faces that are not own: unspecified
  int64_t warped_pixels = 0;
  double seconds_visibility = 0, seconds_photo = 0;
};

// One window's weights: Gaussian of sigma = size / 4, or box.
ZnccWindow MakeWindow(int size_px, bool gaussian);

// The pair as the kernel takes it. `target`: of `other`. `reference` and `target` must outlive the result.
ZnccPair MakeZnccPair(const PhotoView& reference, const PosedCamera& other, const WarpTarget& target,
                      double occlusion_px);

// Evaluates all pairs on a mesh. Holds buffers between calls. Results do not depend on the number of threads.
class PhotoTerm {
 public:
  // `views`, `pairs` and `groups` must outlive this; pairs sorted by reference. `groups`: of the mesh's faces and
  // `views`; null: every view looks at every face.
  PhotoTerm(std::vector<PhotoView>* views, const std::vector<ViewPair>& pairs, const PhotoOptions& options,
            const ViewGroups* groups = nullptr);

  // What each view sees of its own faces and about them, once, while it is at hand: `map` and texels of one window.
  // Called from several threads, for different views.
  using MapVisitor = std::function<void(size_t index, const PhotoView& view, const FaceMap& map)>;

  // Visibility is taken from `mesh` as it is and frozen in the derivatives. `own`: the faces whose sums are wanted;
  // empty: all. The sums of an own face depend on what lies within 2·radius rows and columns of its own pixels in each
  // reference (a pixel is in windows up to `radius` off, which hold pixels up to `radius` further), on the depths and
  // texels where those pixels land in the partners, and on nothing else. `cells`, `clock` and `visit` may be null;
  // `cells`, which are the groups then, spare drawing what cannot be seen (FindCellSight). What a view sees is drawn
  // when the first pair asks for it and dropped after the last: memory is that of the views that are open together, so
  // pairs had better be of views that are near each other in the list.
  void Evaluate(const TriangleMesh& mesh, const std::vector<uint8_t>& own, const MeshCells* cells, const Clock* clock,
                PhotoSums* out, const MapVisitor& visit = nullptr);

  // Gives back what the next Evaluate would use again.
  void ReleaseBuffers();

 private:
  // What a thread needs for a strip.
  struct Workspace {
    ReferenceStrip strip;
    ZnccScratch scratch;
    FaceSlots slots;
  };
  // What an open view has, to be used again by another.
  struct Buffers {
    FaceMap map;
    WarpTarget target;
    Texels target_texels, reference_texels;  // their arrays
  };
  Buffers TakeBuffers(size_t pixels);
  // Whether a view is smaller as a reference than as a target; the reference then has texels of its own.
  bool IsNarrow(size_t view) const { return reference_rects_[view] != target_rects_[view]; }
  const PhotoView& ReferenceOf(size_t view) const { return IsNarrow(view) ? references_[view] : views_[view]; }
  std::unique_ptr<Workspace> TakeWorkspace();
  void ReturnWorkspace(std::unique_ptr<Workspace> workspace);
  void FindWork(const TriangleMesh& mesh, const std::vector<uint8_t>& own, const MeshCells* cells);
  // Draws the views that reference `step` needs and some of the next, so that all threads have work.
  void Open(size_t step, const TriangleMesh& mesh, const std::vector<uint8_t>& own, const MapVisitor& visit);
  void Close(size_t step);
  void EvaluateReference(const TriangleMesh& mesh, const std::vector<uint8_t>& own, size_t first_pair, size_t last_pair,
                         PhotoSums* out);

  std::vector<PhotoView>& views_;
  const std::vector<ViewPair>& pairs_;
  PhotoOptions options_;
  const ViewGroups* groups_;
  Rasterizer rasterizer_;
  // Step i is that of reference i; a view is open from the first step that reads it to the last.
  // What is read of each view: of the mesh, and of the image, by all that land on it and as a reference; nothing where
  // a rectangle is empty.
  std::vector<MeshPart> parts_;
  std::vector<PixelRect> target_rects_, reference_rects_;
  std::vector<PhotoView> references_;         // of narrow views, while they are open
  std::vector<FaceMap> drawn_;                // of views that are being opened
  std::vector<size_t> opening_;               // views by their first step
  std::vector<size_t> first_step_;            // of each view
  std::vector<std::vector<size_t>> closing_;  // views whose last step it is, by step
  size_t opened_ = 0;                         // of opening_
  std::vector<FaceMap> maps_;                 // by view, those of open ones, as references
  std::vector<WarpTarget> targets_;
  std::vector<Buffers> spare_;
  std::vector<Eigen::Vector3d> normals_;
  std::vector<double> plane_;   // of each face: n·V0
  std::vector<float> offsets_;  // of each face from the reference at hand: n·(V0 - C)
  FaceGatherer gatherer_;
  std::mutex workspace_mutex_;
  std::vector<std::unique_ptr<Workspace>> workspaces_;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_PHOTO_PHOTO_TERM_H_
