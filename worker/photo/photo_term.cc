#include "worker/photo/photo_term.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "common/base/machine_limits.h"
#include "common/base/parallel.h"
#include "worker/visibility/visible_cells.h"

namespace tessera {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kStripRows = PhotoView::kWindowStep;
constexpr int64_t kFaceGrain = 2048;

Matrix3d Calibration(const PinholeCamera& k) {
  Matrix3d out = Matrix3d::Identity();
  out(0, 0) = k.fx;
  out(1, 1) = k.fy;
  out(0, 2) = k.cx;
  out(1, 2) = k.cy;
  return out;
}

// Calls body(face) for the faces of a part, on all threads.
template <class Body>
void ForFaces(const MeshPart& part, const Body& body) {
  ForRanges(part.faces, kFaceGrain, [&](int64_t begin, int64_t end) {
    for (int64_t f = begin; f < end; ++f) body(f);
  });
}

// The items of a loop: -1, -2, ... for the long ones, 0, 1, ... for the others. Each thread begins with its own part of
// a loop, so the long ones are distributed over the parts, and are the first there.
std::vector<int64_t> LongFirst(size_t longs, size_t others) {
  const size_t count = longs + others, parts = std::min(static_cast<size_t>(ThreadCount()), count);
  std::vector<int64_t> items;
  int64_t next_long = 0, next_other = 0;
  for (size_t part = 1; part <= parts; ++part) {
    while (static_cast<size_t>(next_long) < part * longs / parts) items.push_back(-1 - next_long++);
    while (items.size() < part * count / parts) items.push_back(next_other++);
  }
  return items;
}

double Seconds(const Clock* clock) { return clock ? 1e-6 * static_cast<double>(clock->MonotonicUs()) : 0; }

}  // namespace

ZnccWindow MakeWindow(int size_px, bool gaussian, ZnccWindow window) {
  window.radius = std::clamp(size_px / 2, 1, ZnccWindow::kMaxRadius);
  const double sigma = (2 * window.radius + 1) / 4.0;
  double sum = 0;
  double taps[2 * ZnccWindow::kMaxRadius + 1] = {};
  for (int k = 0; k <= 2 * window.radius; ++k) {
    const double t = (k - window.radius) / sigma;
    taps[k] = gaussian ? std::exp(-0.5 * t * t) : 1;
    sum += taps[k];
  }
  for (int k = 0; k <= 2 * window.radius; ++k) window.taps[k] = static_cast<float>(taps[k] / sum);
  return window;
}

ZnccPair MakeZnccPair(const PhotoView& reference, const PosedCamera& other, const WarpTarget& target,
                      double occlusion_px) {
  ZnccPair pair;
  pair.reference = &reference.texels;
  pair.other = &target;
  pair.depth_slack = static_cast<float>(occlusion_px / other.intrinsics.fx);
  // q = z·M x̃ + t from the reference's pixels to the other's.
  const PosedCamera &from = reference.camera, &to = other;
  const Matrix3d rotation = to.rotation_cam_from_world * from.rotation_cam_from_world.transpose();
  const Matrix3d k = Calibration(to.intrinsics);
  const Matrix3d m = k * rotation * Calibration(from.intrinsics).inverse();
  const Vector3d t = k * (to.translation_cam_from_world - rotation * from.translation_cam_from_world);
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) pair.m[3 * r + c] = static_cast<float>(m(r, c));
    pair.t[r] = static_cast<float>(t(r));
  }
  return pair;
}

PhotoTerm::PhotoTerm(std::vector<PhotoView>* views, const PhotoOptions& options, const ViewGroups* groups)
    : views_(*views), options_(options), groups_(groups), maps_(views->size()), targets_(views->size()) {
  if (groups == nullptr) return;
  selected_.resize(views->size());
  ParallelForEach(views->size(), 1, [&](size_t v) { selected_[v] = groups->SelectedIn(v); });
}

// The best fitting buffers, so that small views do not keep large buffers.
PhotoTerm::Buffers PhotoTerm::TakeBuffers(size_t pixels) {
  if (spare_.empty()) return Buffers();
  const auto room = [](const Buffers& buffers) { return buffers.map.depth.capacity(); };
  size_t best = 0;
  for (size_t i = 1; i < spare_.size(); ++i) {
    const size_t a = room(spare_[i]), b = room(spare_[best]);
    if (b < pixels ? a > b : a >= pixels && a < b) best = i;
  }
  Buffers buffers = std::move(spare_[best]);
  spare_.erase(spare_.begin() + static_cast<ptrdiff_t>(best));
  return buffers;
}

void PhotoTerm::FindWork(const std::vector<ViewPair>& pairs, const TriangleMesh& mesh, const std::vector<uint8_t>& own,
                         const MeshCells* cells) {
  const CellBoxes boxes(mesh, cells);
  near_own_.clear();
  own_parts_.clear();
  all_parts_.faces = {{0, static_cast<uint32_t>(mesh.faces.size())}};
  target_rects_.clear();
  VisibleCellsProblem problem;
  for (size_t v = 0; v < views_.size(); ++v) {
    const PixelRect all = views_[v].rect();
    problem.views.push_back({views_[v].camera, all});
    target_rects_.push_back(all);
  }
  reference_rects_ = target_rects_;
  references_.resize(views_.size());
  for (size_t v = 0; v < views_.size(); ++v) references_[v].camera = views_[v].camera;
  if (own.empty() || cells == nullptr || groups_ == nullptr) {
    parts_.resize(views_.size());
    ParallelForEach(views_.size(), 1, [&](size_t v) { parts_[v] = boxes.InWindow(problem.views[v], kNearPlane_m); });
    return;
  }
  problem.boxes = boxes.boxes();
  problem.own = OwnCellsOfViews(*cells, own, groups_->selected, views_.size());
  for (const ViewPair& pair : pairs) problem.pairs.push_back({pair.reference, pair.other});
  problem.reference_margin_px = std::max(2 * options_.window.radius, options_.visitor_margin_px);
  problem.target_margin_px = 1;
  const VisibleCells visible = FindVisibleCells(problem);
  parts_.resize(views_.size());
  near_own_.resize(views_.size());
  own_parts_.resize(views_.size());
  ParallelForEach(views_.size(), 1, [&](size_t v) {
    parts_[v] = boxes.PartOf(visible.cells[v]);
    near_own_[v] = boxes.PartOf(visible.own_cells[v]);
    own_parts_[v] = boxes.PartOf(problem.own[v]);
  });
  std::vector<uint8_t> is_drawn(cells->size(), 0);
  for (const std::vector<uint32_t>& of_view : visible.cells) {
    for (const uint32_t c : of_view) is_drawn[c] = 1;
  }
  std::vector<uint32_t> drawn;
  for (uint32_t c = 0; c < is_drawn.size(); ++c) {
    if (is_drawn[c]) drawn.push_back(c);
  }
  all_parts_ = boxes.PartOf(drawn);
  for (size_t v = 0; v < views_.size(); ++v) {
    if (!views_[v].stored) continue;
    const auto window = [&](const PixelRect& needed) {
      return needed.empty() ? PixelRect() : views_[v].FromStep(needed);
    };
    target_rects_[v] = window(visible.windows[v]);
    reference_rects_[v] = window(visible.own_windows[v]);
  }
}

double PhotoTerm::OpenBytes(size_t view) const {
  constexpr double kFaceAndDepth = 8, kTarget = 4, kLuminance = 2, kLikelihoods = 4;  // per pixel
  const int classes = views_[view].stored ? views_[view].stored->classes : views_[view].texels.classes;
  const double planes = (classes + Texels::kClassesPerPlane - 1) / Texels::kClassesPerPlane;
  const double read = kFaceAndDepth + kLuminance + planes * kLikelihoods;
  const auto pixels = [](const PixelRect& rect) { return static_cast<double>(rect.width()) * rect.height(); };
  return (read + kTarget) * pixels(target_rects_[view]) + (IsNarrow(view) ? read * pixels(reference_rects_[view]) : 0);
}

void PhotoTerm::BeginOpening(std::vector<size_t> views) {
  opening_ = std::move(views);
  std::erase_if(opening_, [&](size_t view) { return target_rects_[view].empty(); });
  drawn_.resize(std::max(drawn_.size(), opening_.size()));
  for (const size_t view : opening_) {
    const PixelRect& reference = reference_rects_[view];
    Buffers buffers = TakeBuffers(static_cast<size_t>(reference.width()) * reference.height());
    maps_[view] = std::move(buffers.map);
    targets_[view] = std::move(buffers.target);
    if (views_[view].stored) views_[view].texels = std::move(buffers.target_texels);
    references_[view].texels = std::move(buffers.reference_texels);
  }
}

void PhotoTerm::OpenView(const Arguments& arguments, size_t i, int threads) {
  const size_t v = opening_[i];
  PhotoView& view = views_[v];
  FaceMap& map = maps_[v];
  FaceMap& drawn = IsNarrow(v) ? drawn_[i] : map;
  const FaceSelection selection = groups_ != nullptr ? SelectionOf(*groups_, selected_[v]) : FaceSelection();
  rasterizer_.DrawPart(arguments.mesh, parts_[v], {view.camera, target_rects_[v]}, &drawn, kNearPlane_m, selection,
                       threads);
  if (view.stored) view.stored->LoadWindow(target_rects_[v], &view.texels);
  SetWarpTarget(view.texels, drawn, view.depths, &targets_[v]);
  if (IsNarrow(v)) {  // the target's window contains the reference's
    const PixelRect& narrow = reference_rects_[v];
    if (view.stored) {
      view.texels.CropTo(narrow.x0, narrow.y0, narrow.width(), narrow.height(), &references_[v].texels);
    }
    CropFaceMap(drawn, narrow, &map);
  }
  if (arguments.visit) arguments.visit(v, ReferenceOf(v), map);
  if (!arguments.own.empty()) KeepNearOwn(arguments.own_bits, 2 * options_.window.radius, &map);
}

void PhotoTerm::OpenViews(const Arguments& arguments, size_t first) {
  const size_t most = rasterizer_.MostAtOnce(arguments.mesh);
  for (; first < opening_.size(); first += most) {
    const size_t count = std::min(most, opening_.size() - first);
    const int threads_each = ThreadCount() / static_cast<int>(count);
    ParallelForEach(count, 1, [&](size_t i) { OpenView(arguments, first + i, threads_each); });
  }
}

void PhotoTerm::Close(size_t step) {
  for (const size_t view : schedule_.Close(step)) {
    if (target_rects_[view].empty()) continue;
    Buffers buffers = {std::move(maps_[view]), std::move(targets_[view]), {}, {}};
    if (views_[view].stored) buffers.target_texels = std::move(views_[view].texels);
    buffers.reference_texels = std::move(references_[view].texels);
    spare_.push_back(std::move(buffers));
  }
}

void PhotoTerm::ReleaseBuffers() {
  spare_ = {};
  drawn_ = {};
  workspaces_.clear();
  normals_ = {};
  plane_ = {};
  batch_buffers_ = {};
  rasterizer_ = Rasterizer();
}

std::unique_ptr<PhotoTerm::Workspace> PhotoTerm::TakeWorkspace() {
  const std::lock_guard<std::mutex> lock(workspace_mutex_);
  if (workspaces_.empty()) return std::make_unique<Workspace>();
  std::unique_ptr<Workspace> workspace = std::move(workspaces_.back());
  workspaces_.pop_back();
  return workspace;
}

void PhotoTerm::ReturnWorkspace(std::unique_ptr<Workspace> workspace) {
  const std::lock_guard<std::mutex> lock(workspace_mutex_);
  workspaces_.push_back(std::move(workspace));
}

int PhotoTerm::StripsOf(size_t view) const {
  if (schedule_.pairs(view).empty() || reference_rects_[view].empty()) return 0;
  return (reference_rects_[view].height() + kStripRows - 1) / kStripRows;
}

void PhotoTerm::BeginBatch(const Arguments& arguments, size_t step, size_t end) {
  const TriangleMesh& mesh = arguments.mesh;
  std::vector<size_t> views;
  for (size_t view = step; view < end; ++view) {
    if (StripsOf(view) > 0) views.push_back(view);
  }
  batch_buffers_.resize(std::max(batch_buffers_.size(), views.size()));
  batch_ = std::span(batch_buffers_).first(views.size());
  ParallelForEach(views.size(), 1, [&](size_t i) {
    Reference& reference = batch_[i];
    const size_t view = reference.view = views[i];
    reference.strips = StripsOf(view);
    const PhotoView& from = ReferenceOf(view);
    const Vector3d centre = from.camera.Centre();
    reference.offsets.resize(mesh.faces.size());
    ForFaces(near_own_.empty() ? parts_[view] : near_own_[view], [&](int64_t f) {
      reference.offsets[f] = static_cast<float>(plane_[f] - normals_[f].dot(centre));
    });
    reference.warps.clear();
    for (const ViewPair& pair : schedule_.pairs(view)) {
      const int j = pair.other;
      if (target_rects_[j].empty()) continue;
      reference.warps.push_back(MakeZnccPair(from, views_[j].camera, targets_[j], options_.occlusion_px));
    }
    reference.gatherer.Begin(mesh, own_parts_.empty() ? parts_[view] : own_parts_[view], from.camera, maps_[view],
                             arguments.own, reference.strips, i == 0 ? StripSums::kAtOnce : StripSums::kWait,
                             &arguments.out->faces);
  });
}

ZnccSums PhotoTerm::EvaluateStrip(Reference& reference, int s, const std::vector<uint8_t>& own, Workspace* work) const {
  const PhotoView& view = ReferenceOf(reference.view);
  const FaceMap& map = maps_[reference.view];
  const Texels& texels = view.texels;
  const int row_begin = s * kStripRows, row_end = std::min(texels.height, row_begin + kStripRows);
  ZnccSums sums;
  if (!own.empty()) {
    // Skip strips without own pixels.
    const auto first = map.face.begin() + static_cast<ptrdiff_t>(row_begin) * texels.width;
    const auto last = map.face.begin() + static_cast<ptrdiff_t>(row_end) * texels.width;
    if (std::find_if(first, last, [&](int32_t face) { return face >= 0 && own[face] != 0; }) == last) {
      reference.gatherer.SkipStrip(s);
      return sums;
    }
  }
  ReferenceStrip& strip = work->strip;
  strip.Reset(texels.width, texels.height, options_.window.radius, row_begin, row_end);
  FillStrip(view.camera.intrinsics, texels, map, reference.offsets.data(), &strip);
  SummarizeReference(texels, options_.window, &strip, &work->scratch);
  for (const ZnccPair& warp : reference.warps) {
    sums.Add(AccumulateZncc(warp, options_.window, options_.semantic_weight, &strip, &work->scratch));
  }
  reference.gatherer.AddStrip(s, strip, &work->slots);
  return sums;
}

void PhotoTerm::EvaluateBatch(const Arguments& arguments, size_t opened) {
  struct Strip {
    Reference* reference;
    int strip;
    ZnccSums sums;
  };
  std::vector<Strip> strips;
  for (Reference& reference : batch_) {
    for (int s = 0; s < reference.strips; ++s) strips.push_back({&reference, s, {}});
  }
  const std::vector<int64_t> items = LongFirst(opened, strips.size());
  const size_t count = items.size();
  const int threads_each = ThreadCount() / static_cast<int>(std::max<size_t>(1, count));
  std::vector<double> seconds(count);
  const double start_s = Seconds(arguments.clock);
  ParallelForEach(count, 1, [&](size_t i) {
    const double begin_s = Seconds(arguments.clock);
    if (items[i] < 0) {
      OpenView(arguments, static_cast<size_t>(-1 - items[i]), threads_each);
    } else {
      Strip& strip = strips[static_cast<size_t>(items[i])];
      std::unique_ptr<Workspace> work = TakeWorkspace();
      strip.sums = EvaluateStrip(*strip.reference, strip.strip, arguments.own, work.get());
      ReturnWorkspace(std::move(work));
    }
    seconds[i] = Seconds(arguments.clock) - begin_s;
  });
  const double loop_s = Seconds(arguments.clock) - start_s;
  double all_s = 0, opening_s = 0;
  for (size_t i = 0; i < count; ++i) {
    all_s += seconds[i];
    if (items[i] < 0) opening_s += seconds[i];
  }
  PhotoSums* const out = arguments.out;
  if (all_s > 0) out->seconds_visibility += loop_s * opening_s / all_s;
  for (const Strip& strip : strips) out->sums.Add(strip.sums);
  ParallelForEach(batch_.size(), 1, [&](size_t i) { batch_[i].gatherer.JoinStrips(); });
  for (Reference& reference : batch_) {
    const Texels& texels = ReferenceOf(reference.view).texels;
    out->warped_pixels += static_cast<int64_t>(reference.warps.size()) * texels.height * texels.width;
    reference.gatherer.Finish();
  }
}

void PhotoTerm::Evaluate(const std::vector<ViewPair>& pairs, const TriangleMesh& mesh, const std::vector<uint8_t>& own,
                         const MeshCells* cells, const Clock* clock, PhotoSums* out, const MapVisitor& visit) {
  const double start_s = Seconds(clock);
  schedule_ = ViewSchedule(pairs, views_.size(), static_cast<double>(LookaheadLimit_bytes(ThreadCount())));
  FindWork(pairs, mesh, own, cells);
  normals_.resize(mesh.faces.size());
  plane_.resize(mesh.faces.size());
  out->faces.resize(mesh.faces.size());
  ParallelForEach(mesh.faces.size(), kFaceGrain, [&](size_t f) { out->faces[f] = FaceSums(); });
  ForFaces(all_parts_, [&](int64_t f) {
    normals_[f] = FaceNormal(mesh, f);
    plane_[f] = normals_[f].dot(mesh.Corner(f, 0));
  });
  out->sums = ZnccSums();
  out->warped_pixels = 0;
  const ReferenceWork work = {ThreadCount(), [&](size_t view) { return StripsOf(view); },
                              FaceGatherer::Bytes(mesh) + sizeof(float) * static_cast<double>(mesh.faces.size())};
  const auto bytes = [&](size_t view) { return OpenBytes(view); };
  const Arguments arguments = {mesh, own, FaceBits(own), clock, visit, out};
  out->seconds_visibility = 0;
  for (size_t step = 0; step < views_.size();) {
    const double open_s = Seconds(clock);
    BeginOpening(schedule_.Open(step, work, bytes));
    OpenViews(arguments, 0);
    out->seconds_visibility += Seconds(clock) - open_s;
    const size_t end = schedule_.EndOfBatch(step, work);
    BeginBatch(arguments, step, end);
    BeginOpening(end < views_.size() ? schedule_.OpenAhead(end, work, bytes) : std::vector<size_t>());
    const size_t opened = std::min(opening_.size(), rasterizer_.MostAtOnce(mesh));
    EvaluateBatch(arguments, opened);
    for (; step < end; ++step) Close(step);
    const double rest_s = Seconds(clock);
    OpenViews(arguments, opened);
    out->seconds_visibility += Seconds(clock) - rest_s;
  }
  out->seconds_photo = Seconds(clock) - start_s - out->seconds_visibility;
}

}  // namespace tessera
