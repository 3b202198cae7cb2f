#include "worker/tile/tile_workspace.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/loops/parallel_sort.h"
#include "common/base/machine_limits.h"
#include "common/base/parallel.h"
#include "worker/city/pick.h"
#include "worker/tile/kept/idle_cache.h"
#include "worker/tile/kept/kept_files.h"
#include "worker/tile/regions.h"

namespace tessera {
namespace {

constexpr int64_t kElementGrain = 1 << 14;
constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();

// Approximate bytes per face.
constexpr size_t kPackageBytes = 100, kRegionBytes = 60, kStepperBytes = 300, kRepairBytes = 180, kSnapshotBytes = 50;

// A workspace keeps its repair if it then takes at most this share of the memory of idle workspaces.
constexpr size_t kRepairShare = 4;

// Bound on the bytes of all idle workspaces but one.
size_t IdleLimit_bytes() {
  static const auto limit = static_cast<size_t>(std::min(MemoryLimit_bytes() / 8, int64_t{2} << 30));
  return limit;
}

// Workspaces of recent tasks, so that the next step of a tile need not read its package again.
IdleCache<TileWorkspace>& IdleWorkspaces() {
  static auto* const idle = new IdleCache<TileWorkspace>(IdleLimit_bytes());
  return *idle;
}

}  // namespace

StatusOr<std::string> ContentsKey(const std::vector<std::string>& paths) {
  std::string key;
  for (const std::string& path : paths) {
    TESSERA_ASSIGN_OR_RETURN(const std::string content, ContentKey(path));
    absl::StrAppend(&key, content, ";");
  }
  return key;
}

StatusOr<std::shared_ptr<TileWorkspace>> TileWorkspace::Open(const std::string& path, const std::string& options_key) {
  TESSERA_ASSIGN_OR_RETURN(const std::string content, ContentKey(path));
  const std::string key = absl::StrCat(content, "|", options_key);
  std::unique_ptr<TileWorkspace> work = IdleWorkspaces().Take(key);
  if (work == nullptr) {
    TESSERA_ASSIGN_OR_RETURN(TilePackage package, ReadTilePackage(path));
    work = std::make_unique<TileWorkspace>(std::move(package));
  }
  return std::shared_ptr<TileWorkspace>(work.release(), [key](TileWorkspace* done) {
    const size_t bytes = done->bytes();
    IdleWorkspaces().Put(key, std::unique_ptr<TileWorkspace>(done), bytes);
  });
}

void TrimIdleWorkspaces() { IdleWorkspaces().Trim(); }

StatusOr<TileImages*> TileWorkspace::Images(const std::vector<std::string>& crop_paths,
                                            const TileRefineOptions& options) {
  TESSERA_ASSIGN_OR_RETURN(const std::string content, ContentsKey(crop_paths));
  if (images_ == nullptr || images_content_ != content) {
    TESSERA_ASSIGN_OR_RETURN(std::vector<RefineView> views, OpenTileViews(package_, crop_paths));
    images_ = std::make_unique<TileImages>(package_, std::move(views), options);
    images_content_ = content;
  }
  return images_.get();
}

Stepper& TileWorkspace::SolveStepper(const TileSnapshot& snapshot, const TileRefineOptions& options) {
  const RegionMesh& part = region(kSolveRegion);
  std::vector<int32_t> labels;
  if (GeometryUsesLabels(package_, options)) labels = Pick(snapshot.labels, part.faces);
  std::vector<uint8_t> frozen = Pick(snapshot.frozen_vertices, part.vertices);
  if (stepper_ && stepper_->frozen == frozen) {
    if (stepper_->labels != labels) stepper_->stepper->SetLabels(labels);
    stepper_->labels = std::move(labels);
    return *stepper_->stepper;
  }
  std::vector<uint8_t> active;
  if (!whole_) {
    active.assign(part.vertices.size(), 0);
    for (size_t f = 0; f < part.faces.size(); ++f) {
      if (!(package_.regions[part.faces[f]] & kCoreRegion)) continue;
      for (const uint32_t v : part.mesh().faces[f]) active[v] = 1;
    }
  }
  stepper_.reset();
  stepper_ = std::make_unique<LabelledStepper>();
  stepper_->stepper.emplace(part.surface, labels, part.boundary, package_.gsd_m, package_.up, options.step, active,
                            frozen);
  stepper_->labels = std::move(labels);
  stepper_->frozen = std::move(frozen);
  return *stepper_->stepper;
}

void TileWorkspace::EndIterations() {
  stepper_.reset();
  if (images_ == nullptr) return;
  images_->data_term.ReleaseBuffers();
  images_->surface = TriangleMesh();
}

void TileWorkspace::Forget(Region region) {
  if (!whole_) regions_.erase(region);
}

RegionRepair* TileWorkspace::KeptRepair(const StepperOptions& options) {
  if (repair_ != nullptr) return repair_.get();
  const RegionMesh& part = region(kRepairRegion);
  const size_t with_regions = kPackageBytes + 2 * kRegionBytes + kStepperBytes + kRepairBytes + kSnapshotBytes;
  if (with_regions * package_.face_ids.size() > IdleLimit_bytes() / kRepairShare) return nullptr;
  repair_ = std::make_unique<RegionRepair>(part, MakeMotionLimits(options, package_.gsd_m));
  return repair_.get();
}

size_t TileWorkspace::bytes() const {
  size_t bytes = (kPackageBytes + (snapshot_.empty() ? 0 : kSnapshotBytes)) * package_.face_ids.size();
  if (images_ != nullptr) {
    const TriangleMesh& surface = images_->surface;
    bytes += surface.vertices.size() * sizeof(Eigen::Vector3d) + surface.faces.size() * sizeof(Triangle) +
             surface.labels.size() * sizeof(int32_t);
  }
  if (repair_ != nullptr) bytes += kRepairBytes * repair_->guard.start_normals().size();
  for (const auto& [region, part] : regions_) {
    bytes += (kRegionBytes + (region == kSolveRegion || whole_ ? kStepperBytes : 0)) * part.faces.size();
  }
  return bytes;
}

TileWorkspace::ById::ById(const std::vector<uint32_t>& ids_of_places) {
  std::vector<uint64_t> sorted(ids_of_places.size());  // id and place
  ParallelForEach(sorted.size(), kElementGrain, [&](size_t p) { sorted[p] = uint64_t{ids_of_places[p]} << 32 | p; });
  ParallelSort(&sorted);
  ids.resize(sorted.size());
  places.resize(sorted.size());
  ParallelForEach(sorted.size(), kElementGrain, [&](size_t i) {
    ids[i] = static_cast<uint32_t>(sorted[i] >> 32);
    places[i] = static_cast<uint32_t>(sorted[i]);
  });
}

TileWorkspace::TileWorkspace(TilePackage package)
    : package_(std::move(package)), faces_by_id_(package_.face_ids), vertices_by_id_(package_.vertex_ids) {
  constexpr uint8_t kAllRegions = kCoreRegion | kSolveRegion | kRepairRegion | kLabelRegion;
  for (const uint8_t of_face : package_.regions) {
    measured_.push_back((of_face & (kCoreRegion | kSampleRegion)) != 0);
    whole_ = whole_ && (of_face & kAllRegions) == kAllRegions;
  }
  std::vector<uint8_t> used(package_.vertex_ids.size(), 0);
  for (const uint32_t f : faces_by_id_.places) {
    if (package_.regions[f] & kSampleRegion) sample_faces_.push_back(f);
    if (!(package_.regions[f] & kCoreRegion)) continue;
    core_faces_.push_back(f);
    for (const uint32_t v : package_.mesh.faces[f]) used[v] = 1;
  }
  for (const uint32_t v : vertices_by_id_.places) {
    if (used[v]) core_vertices_.push_back(v);
  }
}

const RegionMesh& TileWorkspace::region(Region region) {
  if (whole_) region = kCoreRegion;
  const auto [entry, is_new] = regions_.try_emplace(region);
  RegionMesh& out = entry->second;
  if (!is_new) return out;
  const TriangleMesh& mesh = package_.mesh;
  std::vector<uint8_t> flags(mesh.faces.size());
  for (size_t f = 0; f < flags.size(); ++f) flags[f] = (package_.regions[f] & region) != 0;
  PickedMesh picked = PickFlagged(mesh, flags);
  out.surface = std::move(picked.mesh);
  out.vertices = std::move(picked.vertices);
  out.faces = std::move(picked.faces);
  for (const uint32_t v : out.vertices) out.boundary.push_back((package_.cut_regions[v] & region) != 0);
  out.cell.resize(out.faces.size());
  ParallelForEach(out.faces.size(), kElementGrain, [&](size_t i) {
    out.cell[i] = LabelCellOf(package_.ground, package_.gsd_m, MeshSpans(mesh).Centroid(out.faces[i]));
  });
  if (std::find(out.boundary.begin(), out.boundary.end(), 1) == out.boundary.end()) out.boundary.clear();
  return out;
}

StatusOr<TileSnapshot> TileWorkspace::Assemble(const std::vector<StateSpans>& states, uint8_t region,
                                               const std::vector<int>& frozen, int64_t first_new_face) {
  TileSnapshot snapshot;
  snapshot.positions = package_.mesh.vertices;
  snapshot.labels = package_.mesh.labels;
  if (states.empty()) return snapshot;
  const auto is_frozen = [&](const StateSpans& s) {
    return std::find(frozen.begin(), frozen.end(), s.tile) != frozen.end();
  };
  // Frozen tiles may be at any level.
  const bool in_level = std::any_of(states.begin(), states.end(),
                                    [&](const StateSpans& s) { return !is_frozen(s) && !s.level_start.empty(); });
  const bool others_begin = std::all_of(states.begin(), states.end(), is_frozen);
  if (in_level) {
    snapshot.level_start = package_.mesh.vertices;
    snapshot.last_step.assign(snapshot.positions.size(), Eigen::Vector3f::Zero());
  }
  std::vector<uint8_t> has_vertex(snapshot.positions.size(), 0), has_face(snapshot.labels.size(), 0);
  snapshot.confidence.assign(snapshot.labels.size(), 0.0f);
  if (!frozen.empty()) {
    snapshot.frozen_vertices.assign(has_vertex.size(), 0);
    snapshot.frozen_faces.assign(has_face.size(), 0);
  }
  for (const StateSpans& state : states) {
    const bool of_frozen = is_frozen(state);
    // Frozen vertices have not moved since the level's start.
    const std::span<const Eigen::Vector3d> level_start = of_frozen ? state.positions : state.level_start;
    if (in_level && (level_start.empty() || (!of_frozen && state.last_step.empty()))) {
      return absl::DataLossError(absl::StrCat("tile ", package_.tile, ": the state of tile ", state.tile,
                                              " lacks the level's start, which other states have"));
    }
    vertices_by_id_.ForShared(state.vertex_ids, [&](size_t i, uint32_t v) {
      if (of_frozen) snapshot.frozen_vertices[v] = 1;
      if (has_vertex[v]) {
        ++snapshot.compared;
        if (std::memcmp(snapshot.positions[v].data(), state.positions[i].data(), 3 * sizeof(double)) != 0) {
          ++snapshot.different;
          const double apart_m = (snapshot.positions[v] - state.positions[i]).norm();
          if (apart_m >= snapshot.farthest_m) snapshot.farthest_at = snapshot.positions[v];
          snapshot.farthest_m = std::max(snapshot.farthest_m, apart_m);
        }
        return;
      }
      has_vertex[v] = 1;
      snapshot.positions[v] = state.positions[i];
      if (!in_level) return;
      snapshot.level_start[v] = level_start[i];
      if (!of_frozen) snapshot.last_step[v] = state.last_step[i];
    });
    faces_by_id_.ForShared(state.face_ids, [&](size_t i, uint32_t f) {
      has_face[f] = 1;
      if (of_frozen) snapshot.frozen_faces[f] = 1;
      snapshot.labels[f] = state.labels[i];
      snapshot.confidence[f] = state.confidence[i];
    });
    if (state.tile == package_.tile) snapshot.report = state.report;
  }
  for (size_t f = 0; !others_begin && f < has_face.size(); ++f) {
    if (first_new_face >= 0 && package_.face_ids[f] >= first_new_face) continue;
    const Triangle& face = package_.mesh.faces[f];
    if (has_face[f] && has_vertex[face[0]] && has_vertex[face[1]] && has_vertex[face[2]]) continue;
    snapshot.covered &= static_cast<uint8_t>(~package_.regions[f]);
    if (!(package_.regions[f] & region)) continue;
    return absl::DataLossError(absl::StrCat("tile ", package_.tile, ": no state has face ", package_.face_ids[f]));
  }
  if (others_begin) snapshot.confidence.clear();  // the core's faces have no confidence yet
  return snapshot;
}

void KeptSnapshot::Keep(std::string states_key, TileSnapshot snapshot) {
  states_key_ = std::move(states_key);
  snapshot_ = std::move(snapshot);
}

std::optional<TileSnapshot> KeptSnapshot::Take(const std::string& states_key, uint8_t region) {
  std::optional<TileSnapshot> taken = std::exchange(snapshot_, std::nullopt);
  if (taken && (states_key_ != states_key || (region & ~taken->covered) != 0)) taken.reset();
  return taken;
}

std::vector<uint32_t> TileWorkspace::PlacesIn(const RegionMesh& part) const {
  std::vector<uint32_t> places(package_.face_ids.size(), kNone);
  for (uint32_t i = 0; i < part.faces.size(); ++i) places[part.faces[i]] = i;
  return places;
}

template <class Take>
Status TileWorkspace::AssembleFaces(const SumsOfTiles& sums, const RegionMesh& part, const char* what,
                                    const std::vector<uint8_t>& frozen, const Take& take) const {
  std::vector<uint8_t> has(part.faces.size(), 0);
  const std::vector<uint32_t> local = PlacesIn(part);
  for (const auto& tile : sums) {
    faces_by_id_.ForShared(tile->face_ids, [&](size_t i, uint32_t f) {
      const uint32_t at = local[f];
      if (at != kNone && take(*tile, i, at)) has[at] = 1;
    });
  }
  for (size_t i = 0; i < has.size(); ++i) {
    const uint32_t f = part.faces[i];
    if (!has[i] && (frozen.empty() || !frozen[f])) {
      return absl::DataLossError(
          absl::StrCat("tile ", package_.tile, ": no ", what, " of face ", package_.face_ids[f]));
    }
  }
  return absl::OkStatus();
}

StatusOr<std::vector<FaceSums>> TileWorkspace::AssemblePhoto(const SumsOfTiles& sums, Region region,
                                                             const std::vector<uint8_t>& frozen) {
  const RegionMesh& part = this->region(region);
  std::vector<FaceSums> out(part.faces.size());
  TESSERA_RETURN_IF_ERROR(AssembleFaces(sums, part, "sums", frozen, [&](const TileSums& tile, size_t i, uint32_t at) {
    if (tile.photo.empty()) return false;
    out[at] = tile.photo[i];
    return true;
  }));
  return out;
}

StatusOr<ContourSums> TileWorkspace::AssembleContours(const SumsOfTiles& sums, Region region) {
  struct Entry {
    uint32_t face;
    const TileSums* tile;
    const FaceContour* contour;
  };
  const RegionMesh& part = this->region(region);
  const std::vector<uint32_t> local = PlacesIn(part);
  std::vector<Entry> entries;
  for (const auto& tile : sums) {
    std::vector<uint32_t> place(tile->face_ids.size(), kNone);
    faces_by_id_.ForShared(tile->face_ids, [&](size_t i, uint32_t f) { place[i] = local[f]; });
    for (const FaceContour& contour : tile->contours.faces) {
      if (place[contour.face] != kNone) entries.push_back({place[contour.face], tile.get(), &contour});
    }
  }
  std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) { return a.face < b.face; });
  ContourSums out;
  size_t views = 0;
  for (const Entry& entry : entries) views += entry.contour->views_end - entry.contour->views_begin;
  out.faces.reserve(entries.size());
  out.views.reserve(views);
  for (const Entry& entry : entries) out.Append(entry.face, *entry.contour, entry.tile->contours.views);
  return out;
}

StatusOr<FaceLikelihoods> TileWorkspace::AssembleLikelihoods(const SumsOfTiles& sums, Region region,
                                                             const std::vector<uint8_t>& frozen) {
  const RegionMesh& part = this->region(region);
  const int classes = static_cast<int>(package_.classes.size());
  FaceLikelihoods out(part.faces.size(), classes);
  TESSERA_RETURN_IF_ERROR(
      AssembleFaces(sums, part, "likelihoods", frozen, [&](const TileSums& tile, size_t i, uint32_t at) {
        if (tile.pixels.empty() || tile.classes != classes) return false;
        out.pixels[at] = tile.pixels[i];
        std::copy_n(&tile.likelihoods[i * classes], classes, &out.sum[static_cast<size_t>(at) * classes]);
        return true;
      }));
  return out;
}

TileState TileWorkspace::StateOf(const TileSnapshot& snapshot) const {
  TileState state;
  state.tile = package_.tile;
  state.vertex_ids = Pick(package_.vertex_ids, core_vertices_);
  state.positions = Pick(snapshot.positions, core_vertices_);
  state.level_start = Pick(snapshot.level_start, core_vertices_);
  state.last_step = Pick(snapshot.last_step, core_vertices_);
  state.face_ids = Pick(package_.face_ids, core_faces_);
  state.labels = Pick(snapshot.labels, core_faces_);
  state.confidence = Pick(snapshot.confidence, core_faces_);
  if (state.confidence.empty()) state.confidence.assign(state.face_ids.size(), 0.0f);
  state.report = snapshot.report;
  return state;
}

}  // namespace tessera
