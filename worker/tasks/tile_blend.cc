#include "worker/tasks/tile_blend.h"

#include <algorithm>
#include <numeric>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

constexpr int64_t kGrain = 4096;

// The first failure of `body` over all items, in their order; otherwise OK.
template <class Body>
Status ForEachOrFail(size_t count, const Body& body) {
  std::vector<Status> failures((count + kGrain - 1) / kGrain);
  ParallelFor(static_cast<int64_t>(count), kGrain, [&](int64_t begin, int64_t end) {
    Status& failure = failures[begin / kGrain];
    for (int64_t i = begin; i < end && failure.ok(); ++i) failure = body(static_cast<size_t>(i));
  });
  for (const Status& failure : failures) TESSERA_RETURN_IF_ERROR(failure);
  return absl::OkStatus();
}

}  // namespace

TileBlend::IdIndex::IdIndex(const std::vector<uint32_t>& ids) : order_(ids.size()), ids_(&ids) {
  std::iota(order_.begin(), order_.end(), 0u);
  // Stable, so that of doubled vertices the first is found.
  std::stable_sort(order_.begin(), order_.end(), [&](uint32_t a, uint32_t b) { return ids[a] < ids[b]; });
}

bool TileBlend::IdIndex::Find(uint32_t id, uint32_t* at) const {
  const auto it =
      std::lower_bound(order_.begin(), order_.end(), id, [&](uint32_t i, uint32_t key) { return (*ids_)[i] < key; });
  if (it == order_.end() || (*ids_)[*it] != id) return false;
  *at = *it;
  return true;
}

StatusOr<TileBlend> TileBlend::Create(int reader, int classes, const GroundPlane& ground, double blend_m,
                                      const std::vector<TileResult>& results,
                                      const std::vector<TileParameters>& tiles) {
  for (size_t r = 0; r < std::max(results.size(), tiles.size()); ++r) {
    if (r < results.size() && r < tiles.size() && results[r].tile == tiles[r].tile && results[r].classes == classes) {
      continue;
    }
    return absl::DataLossError(absl::StrCat("tile ", reader, ": the results are not those expected"));
  }
  TileBlend blend;
  blend.reader_ = reader;
  blend.ground_ = &ground;
  blend.blend_m_ = blend_m;
  blend.tiles_ = &tiles;
  for (const TileResult& result : results) {
    blend.vertex_index_.emplace_back(result.vertex_ids);
    blend.face_index_.emplace_back(result.face_ids);
  }
  return blend;
}

StatusOr<std::vector<TileBlend::Share>> TileBlend::OfVertex(uint32_t id, const Vector3d& at) const {
  return Of("vertex", vertex_index_, id, at);
}

StatusOr<std::vector<TileBlend::Share>> TileBlend::OfFace(uint32_t id, const Vector3d& at) const {
  return Of("face", face_index_, id, at);
}

StatusOr<std::vector<TileBlend::Share>> TileBlend::Of(const char* what, const std::vector<IdIndex>& index, uint32_t id,
                                                      const Vector3d& at) const {
  const Eigen::Vector2d place = ground_->Coordinates(at);
  std::vector<Share> shares;
  uint32_t found = 0;
  for (size_t r = 0; r < index.size(); ++r) {
    const double weight = BlendWeight(DistanceToRect(place, (*tiles_)[r].core, ground_->cell_m), blend_m_);
    if (weight > 0 && index[r].Find(id, &found)) shares.push_back({r, found, weight});
  }
  for (size_t r = 0; r < index.size() && shares.empty(); ++r) {
    if (index[r].Find(id, &found)) shares.push_back({r, found, 1});
  }
  if (!shares.empty()) return shares;
  return absl::DataLossError(absl::StrCat("tile ", reader_, ": no result has ", what, " ", id));
}

StatusOr<TileState> JoinResults(const TilePackage& package, const std::vector<TileResult>& results,
                                const std::vector<TileParameters>& tiles, double blend_m) {
  TESSERA_ASSIGN_OR_RETURN(const TileBlend blend,
                           TileBlend::Create(package.tile, static_cast<int>(package.classes.size()), package.ground,
                                             blend_m, results, tiles));
  bool in_level = false;
  for (const TileResult& result : results) in_level = in_level || !result.level_start.empty();
  TileState state;
  const size_t vertices = package.vertex_ids.size();
  state.positions.resize(vertices);
  if (in_level) state.level_start.resize(vertices);
  TESSERA_RETURN_IF_ERROR(ForEachOrFail(vertices, [&](size_t v) -> Status {
    TESSERA_ASSIGN_OR_RETURN(const std::vector<TileBlend::Share> shares,
                             blend.OfVertex(package.vertex_ids[v], package.mesh.vertices[v]));
    state.positions[v] =
        BlendedPosition(shares, [&](const TileBlend::Share& s) { return results[s.result].positions[s.index]; });
    if (!in_level) return absl::OkStatus();
    state.level_start[v] = BlendedPosition(shares, [&](const TileBlend::Share& s) {
      const TileResult& result = results[s.result];
      // A tile that has no views did not begin the level: it stands still.
      return (result.level_start.empty() ? result.positions : result.level_start)[s.index];
    });
    return absl::OkStatus();
  }));
  state.labels.resize(package.face_ids.size());
  TESSERA_RETURN_IF_ERROR(ForEachOrFail(state.labels.size(), [&](size_t f) -> Status {
    const Vector3d centroid = MeshSpans(package.mesh).Centroid(f);
    TESSERA_ASSIGN_OR_RETURN(const std::vector<TileBlend::Share> shares, blend.OfFace(package.face_ids[f], centroid));
    const TileBlend::Share* owner = &shares[0];
    for (const TileBlend::Share& share : shares) {
      if (tiles[share.result].core.Contains(package.ground.Cell(centroid))) owner = &share;
    }
    state.labels[f] = results[owner->result].labels[owner->index];
    return absl::OkStatus();
  }));
  for (const TileResult& result : results) {
    if (result.tile == package.tile) state.report = result.report;
  }
  return state;
}

void KeepBlended(const TilePackage& package, const CellRect& core, double blend_m, TileResult* result) {
  const int classes = result->classes;
  std::vector<uint8_t> keep_face(package.face_ids.size()), keep_vertex(package.vertex_ids.size(), 0);
  for (size_t f = 0; f < keep_face.size(); ++f) {
    const Eigen::Vector2d at = package.ground.Coordinates(MeshSpans(package.mesh).Centroid(f));
    keep_face[f] = package.core[f] || DistanceToRect(at, core, package.ground.cell_m) < blend_m;
    if (!keep_face[f]) continue;
    for (const uint32_t v : package.mesh.faces[f]) keep_vertex[v] = 1;
  }
  const auto filter = [](const std::vector<uint8_t>& keep, size_t each, auto* values) {
    if (values->empty()) return;
    size_t n = 0;
    for (size_t i = 0; i < keep.size(); ++i) {
      for (size_t k = 0; keep[i] && k < each; ++k) (*values)[n++] = (*values)[i * each + k];
    }
    values->resize(n);
  };
  filter(keep_vertex, 1, &result->vertex_ids);
  filter(keep_vertex, 1, &result->positions);
  filter(keep_vertex, 1, &result->level_start);
  filter(keep_face, 1, &result->face_ids);
  filter(keep_face, 1, &result->labels);
  filter(keep_face, static_cast<size_t>(classes), &result->beliefs);
  filter(keep_face, 1, &result->seen);
}

}  // namespace tessera
