// The data term E_photo + λ1 E_sem of all view pairs: 1 - ZNCC over windows, and half the squared differences of
// class likelihoods per pixel. Gradient and Gauss-Newton curvature at the vertices as in Bláha et al. 2017, eq. 2-5,
// but with the exact derivative of the windowed score instead of the pointwise approximation.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <vector>

#include "common/base/clock.h"
#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"
#include "worker/photo/face_sums.h"
#include "worker/photo/pairs.h"
#include "worker/photo/stored_texels.h"
#include "worker/photo/texels.h"
#include "worker/photo/view_schedule.h"
#include "worker/photo/warp_target.h"
#include "worker/photo/zncc_kernel.h"
#include "worker/visibility/rasterizer.h"
#include "worker/visibility/view_groups.h"

namespace tessera {

// A view at one pyramid level: the whole image's camera and the texels that the mesh can cover, or the store from
// which they are loaded while the view is open. The camera's pixel origin is arbitrary; its width and height are
// ignored.
struct PhotoView {
  // Sums are computed in strips and blocks relative to the window's corner. If the corner is a multiple of this in
  // both directions, a face has the same sums, bit for bit, in every window that contains it and its surroundings.
  static constexpr int kWindowStep = 64;

  PosedCamera camera;
  Texels texels;
  DepthRange depths = {};  // empty: derived from the visible mesh, so results depend on all of the mesh
  std::optional<StoredTexels> stored = std::nullopt;
  int step_x = 0, step_y = 0;  // origin of the window steps on `stored`

  // Aligns the corner down to a window step.
  PixelRect FromStep(const PixelRect& rect) const {
    const auto before = [](int x, int step) { return x - ((x - step) % kWindowStep + kWindowStep) % kWindowStep; };
    return {before(rect.x0, step_x), before(rect.y0, step_y), rect.x1, rect.y1};
  }
  // The window that covers all available pixels.
  PixelRect rect() const {
    if (stored) return FromStep(stored->rect);
    return {texels.x0, texels.y0, texels.x0 + texels.width, texels.y0 + texels.height};
  }
};

struct PhotoOptions {
  ZnccWindow window;
  float semantic_weight = 0;  // λ1, of E_sem; ignored for pairs of which a view has no likelihoods
  double occlusion_px = 1;    // tolerance of the depth test, in pixels of the other view
  int visitor_margin_px = 0;  // margin around own faces' pixels that the visitor reads
};

// Sums over all views.
struct PhotoSums {
  ZnccSums sums;                // over windows and pixels
  std::vector<FaceSums> faces;  // derivatives of energy + λ1 semantic_energy; undefined for faces that are not own
  int64_t warped_pixels = 0;
  // Visibility: opening views; of a loop that also evaluates references, a share by the time of its items.
  double seconds_visibility = 0, seconds_photo = 0;
};

// `window` with the size and the weights set: Gaussian of sigma = size / 4, or box.
ZnccWindow MakeWindow(int size_px, bool gaussian, ZnccWindow window = {});

// The kernel's parameters of a pair. `target`: of `other`. `reference` and `target` must outlive the result.
ZnccPair MakeZnccPair(const PhotoView& reference, const PosedCamera& other, const WarpTarget& target,
                      double occlusion_px);

// Evaluates all pairs on a mesh. Owns buffers that are reused between calls. Results do not depend on the number of
// threads.
class PhotoTerm {
 public:
  // `views` and `groups` must outlive the object. `groups`: view selection for the mesh's faces; null: every view is
  // selected for every face.
  PhotoTerm(std::vector<PhotoView>* views, const PhotoOptions& options, const ViewGroups* groups = nullptr);

  // Called once per view with the map of own faces and their surroundings, and the texels of the same window. Called
  // from several threads, for different views.
  using MapVisitor = std::function<void(size_t index, const PhotoView& view, const FaceMap& map)>;

  // Evaluates `pairs`, sorted by reference. Visibility is computed from `mesh` and kept constant in the derivatives.
  // `own`: flags of the faces to sum, the own faces; empty: all.
  // Dependency: the sums of an own face depend only on the pixels within 2·radius rows and columns of its own pixels
  // in each reference, and on the depths and texels where those pixels are warped to in the partners. (A pixel
  // belongs to windows up to `radius` away, which contain pixels up to `radius` further.)
  // `cells`, `clock` and `visit` may be null. With `cells`, group i of `groups` must be cell i, and invisible cells are
  // not drawn (FindVisibleCells). A view is drawn when the first pair needs it and freed after the last one, so memory
  // is bounded by the views open at the same time: views of a pair should be close in the list. While references are
  // evaluated, the views of the next ones are opened. For many threads that are several references: up to
  // LookaheadLimit_bytes of their views are open, and as much is used to evaluate several together.
  void Evaluate(const std::vector<ViewPair>& pairs, const TriangleMesh& mesh, const std::vector<uint8_t>& own,
                const MeshCells* cells, const Clock* clock, PhotoSums* out, const MapVisitor& visit = nullptr);

  // Frees buffers that the next Evaluate would reuse.
  void ReleaseBuffers();

 private:
  // Buffers of a thread for one strip.
  struct Workspace {
    ReferenceStrip strip;
    ZnccScratch scratch;
    FaceSlots slots;
  };
  // A reference that is being evaluated. Its buffers are reused by later ones.
  struct Reference {
    size_t view = 0;
    int strips = 0;
    std::vector<float> offsets;  // per face, relative to the view: n·(V0 - C)
    std::vector<ZnccPair> warps;
    FaceGatherer gatherer;
  };
  // Of Evaluate.
  struct Arguments {
    const TriangleMesh& mesh;
    const std::vector<uint8_t>& own;
    const FaceBits own_bits;
    const Clock* clock;
    const MapVisitor& visit;
    PhotoSums* out;
  };
  // Buffers of an open view, reused by later ones.
  struct Buffers {
    FaceMap map;
    WarpTarget target;
    Texels target_texels, reference_texels;  // only their arrays
  };
  Buffers TakeBuffers(size_t pixels);
  // Whether a view's window is smaller as a reference than as a target. The reference then has its own texels.
  bool IsNarrow(size_t view) const { return reference_rects_[view] != target_rects_[view]; }
  const PhotoView& ReferenceOf(size_t view) const { return IsNarrow(view) ? references_[view] : views_[view]; }
  std::unique_ptr<Workspace> TakeWorkspace();
  void ReturnWorkspace(std::unique_ptr<Workspace> workspace);
  void FindWork(const std::vector<ViewPair>& pairs, const TriangleMesh& mesh, const std::vector<uint8_t>& own,
                const MeshCells* cells);
  // Memory of a view while it is open.
  double OpenBytes(size_t view) const;
  // Sets `opening_` to those of these views that are read, and takes buffers for them.
  void BeginOpening(std::vector<size_t> views);
  // Opens a view of `opening_`, on `threads` threads. Thread-safe for different views.
  void OpenView(const Arguments& arguments, size_t i, int threads);
  // Opens the views of `opening_` from `first` on.
  void OpenViews(const Arguments& arguments, size_t first);
  void Close(size_t step);
  // Strips of a view as a reference; 0: it has no pairs or no pixels.
  int StripsOf(size_t view) const;
  // Sets `batch_` up for references [step, end), which are evaluated together.
  void BeginBatch(const Arguments& arguments, size_t step, size_t end);
  // Evaluates `batch_`, and opens the first `opened` views of `opening_` meanwhile. The sums of a face are added in the
  // order of the references.
  void EvaluateBatch(const Arguments& arguments, size_t opened);
  // A strip of a reference of `batch_`.
  ZnccSums EvaluateStrip(Reference& reference, int strip, const std::vector<uint8_t>& own, Workspace* work) const;

  std::vector<PhotoView>& views_;
  PhotoOptions options_;
  const ViewGroups* groups_;
  std::vector<std::vector<uint8_t>> selected_;  // per view: ViewGroups::SelectedIn
  Rasterizer rasterizer_;
  ViewSchedule schedule_;
  // parts_: the cells of the mesh drawn per view. all_parts_: those of any view. near_own_, own_parts_: per view, those
  // that the reference may show near own pixels, and those with own faces; empty: as parts_. target_rects_,
  // reference_rects_: the pixels read as a target and as a reference; empty: none.
  std::vector<MeshPart> parts_, near_own_, own_parts_;
  MeshPart all_parts_;
  std::vector<PixelRect> target_rects_, reference_rects_;
  std::vector<PhotoView> references_;         // of narrow views while open
  std::vector<size_t> opening_;               // views being opened
  std::vector<FaceMap> drawn_;                // of narrow views of `opening_`
  std::vector<FaceMap> maps_;                 // per view while open, as references
  std::vector<WarpTarget> targets_;
  std::vector<Buffers> spare_;
  std::vector<Eigen::Vector3d> normals_;
  std::vector<double> plane_;  // per face: n·V0
  std::vector<Reference> batch_buffers_;
  std::span<Reference> batch_;  // those in use
  std::mutex workspace_mutex_;
  std::vector<std::unique_ptr<Workspace>> workspaces_;
};

}  // namespace tessera
