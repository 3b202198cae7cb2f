#include "worker/tasks/stitch_tile.h"

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>

#include "worker/label/belief_propagation.h"

namespace tessera {
namespace {

constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();

// Finds where a global id lies in a result.
class IdIndex {
 public:
  explicit IdIndex(const std::vector<uint32_t>& ids) : order_(ids.size()), ids_(ids) {
    std::iota(order_.begin(), order_.end(), 0u);
    // Stable, so that of doubled vertices the first is found.
    std::stable_sort(order_.begin(), order_.end(), [&](uint32_t a, uint32_t b) { return ids[a] < ids[b]; });
  }
  uint32_t Find(uint32_t id) const {
    const auto it =
        std::lower_bound(order_.begin(), order_.end(), id, [&](uint32_t at, uint32_t key) { return ids_[at] < key; });
    return it != order_.end() && ids_[*it] == id ? *it : kNone;
  }

 private:
  std::vector<uint32_t> order_;
  const std::vector<uint32_t>& ids_;
};

// What the tiles said differently where they overlap, before blending.
struct SeamResidual {
  int64_t vertices = 0, faces = 0, label_differences = 0;
  double sum_squared_m2 = 0, max_m = 0;
};

class Stitcher {
 public:
  Stitcher(const TilePackage& package, const std::vector<TileResult>& results, const StitchParameters& parameters)
      : package_(package), results_(results), parameters_(parameters) {
    for (const TileResult& result : results) {
      vertex_index_.emplace_back(result.vertex_ids);
      face_index_.emplace_back(result.face_ids);
    }
  }

  Status BlendVertices(TileCore* core, SeamResidual* seam) const;
  Status BlendFaces(TileCore* core, SeamResidual* seam) const;

 private:
  double Weight(size_t result, const Eigen::Vector3d& p) const {
    const Eigen::Vector2d q = package_.ground.Coordinates(p);
    const CellRect& rect = parameters_.results[result].core;
    return BlendWeight(DistanceToRect(q, rect, package_.ground.cell_m), parameters_.blend_m);
  }
  Status Missing(const char* what, uint32_t id) const {
    return absl::DataLossError("tile " + std::to_string(package_.tile) + ": no result has " + what + " " +
                               std::to_string(id) + " of its core");
  }

  const TilePackage& package_;
  const std::vector<TileResult>& results_;
  const StitchParameters& parameters_;
  std::vector<IdIndex> vertex_index_, face_index_;
};

Status Stitcher::BlendVertices(TileCore* core, SeamResidual* seam) const {
  std::vector<uint32_t> locals;  // one for each vertex of core faces
  {
    std::vector<uint8_t> used(package_.vertex_ids.size(), 0);
    for (size_t f = 0; f < package_.core.size(); ++f) {
      if (!package_.core[f]) continue;
      for (const uint32_t v : package_.mesh.faces[f]) used[v] = 1;
    }
    for (size_t v = 0; v < used.size(); ++v) {
      if (used[v]) locals.push_back(static_cast<uint32_t>(v));
    }
    std::stable_sort(locals.begin(), locals.end(),
                     [&](uint32_t a, uint32_t b) { return package_.vertex_ids[a] < package_.vertex_ids[b]; });
  }
  for (const uint32_t v : locals) {
    const uint32_t id = package_.vertex_ids[v];
    if (!core->vertex_ids.empty() && core->vertex_ids.back() == id) continue;  // doubled by the cut
    const Eigen::Vector3d& start = package_.mesh.vertices[v];
    double total = 0;
    int tiles = 0;
    Eigen::Vector3d sum = Eigen::Vector3d::Zero(), first = sum, only = sum;
    for (size_t r = 0; r < results_.size(); ++r) {
      const double weight = Weight(r, start);
      if (weight <= 0) continue;
      const uint32_t at = vertex_index_[r].Find(id);
      if (at == kNone) continue;
      const Eigen::Vector3d& d = results_[r].displacements[at];
      if (tiles == 0) {
        first = only = d;
      } else {
        const double difference_m = (d - first).norm();
        ++seam->vertices;
        seam->sum_squared_m2 += difference_m * difference_m;
        seam->max_m = std::max(seam->max_m, difference_m);
      }
      ++tiles;
      total += weight;
      sum += weight * d;
    }
    if (tiles == 0) return Missing("vertex", id);
    const Eigen::Vector3d moved = tiles == 1 ? only : Eigen::Vector3d(sum / total);
    core->vertex_ids.push_back(id);
    core->positions.push_back(start + moved);
  }
  return absl::OkStatus();
}

Status Stitcher::BlendFaces(TileCore* core, SeamResidual* seam) const {
  const int classes = static_cast<int>(package_.classes.size());
  std::vector<float> beliefs;
  std::vector<uint8_t> seen;
  for (size_t f = 0; f < package_.core.size(); ++f) {
    if (!package_.core[f]) continue;
    const uint32_t id = package_.face_ids[f];
    const TriangleMesh& mesh = package_.mesh;
    const Eigen::Vector3d centroid = (mesh.Corner(f, 0) + mesh.Corner(f, 1) + mesh.Corner(f, 2)) / 3;
    std::vector<double> sum(classes, 0.0);
    double total = 0;
    int tiles = 0;
    bool is_seen = false;
    int32_t first_label = -1;
    for (size_t r = 0; r < results_.size(); ++r) {
      const double weight = Weight(r, centroid);
      const uint32_t at = weight > 0 ? face_index_[r].Find(id) : kNone;
      if (at == kNone) continue;
      if (tiles++ == 0) {
        first_label = results_[r].labels[at];
      } else {
        ++seam->faces;
        seam->label_differences += results_[r].labels[at] != first_label;
      }
      total += weight;
      is_seen |= results_[r].seen[at] != 0;
      for (int l = 0; l < classes; ++l) sum[l] += weight * results_[r].beliefs[static_cast<size_t>(at) * classes + l];
    }
    if (tiles == 0) return Missing("face", id);
    const size_t best = std::min_element(sum.begin(), sum.end()) - sum.begin();
    core->face_ids.push_back(id);
    // A face that nobody labelled (label -1) has equal beliefs everywhere, and stays so.
    core->labels.push_back(first_label < 0 ? -1 : static_cast<int32_t>(best));
    for (int l = 0; l < classes; ++l) beliefs.push_back(static_cast<float>((sum[l] - sum[best]) / total));
    seen.push_back(is_seen);
  }
  std::vector<int32_t> known = core->labels;
  for (int32_t& label : known) label = std::max(label, 0);
  core->confidence = LabelConfidence(classes, beliefs, known);
  for (size_t f = 0; f < seen.size(); ++f) {
    if (!seen[f]) core->confidence[f] = 0;
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<TileCore> StitchTile(const TilePackage& package, const std::vector<TileResult>& results,
                              const StitchParameters& parameters) {
  const TileResult* own = nullptr;
  for (size_t r = 0; r < results.size(); ++r) {
    if (results.size() != parameters.results.size() || results[r].tile != parameters.results[r].tile ||
        results[r].classes != static_cast<int>(package.classes.size())) {
      return absl::DataLossError("tile " + std::to_string(package.tile) + ": the results are not those expected");
    }
    if (results[r].tile == package.tile) own = &results[r];
  }
  if (own == nullptr) return absl::DataLossError("tile " + std::to_string(package.tile) + ": found no own result");

  TileCore core;
  core.tile = package.tile;
  SeamResidual seam;
  const Stitcher stitcher(package, results, parameters);
  TESSERA_RETURN_IF_ERROR(stitcher.BlendVertices(&core, &seam));
  TESSERA_RETURN_IF_ERROR(stitcher.BlendFaces(&core, &seam));
  nlohmann::json report = nlohmann::json::parse(own->report);
  report["core_faces"] = core.face_ids.size();
  report["seam"] = {{"vertices", seam.vertices},
                    {"sum_squared_m2", seam.sum_squared_m2},
                    {"max_m", seam.max_m},
                    {"faces", seam.faces},
                    {"label_differences", seam.label_differences}};
  core.report = report.dump();
  return core;
}

}  // namespace tessera
