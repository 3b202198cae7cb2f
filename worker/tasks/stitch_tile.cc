#include "worker/tasks/stitch_tile.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "worker/label/belief_propagation.h"
#include "worker/tasks/tile_blend.h"

namespace tessera {
namespace {

// What the tiles said differently where they overlap, before blending.
struct SeamResidual {
  int64_t vertices = 0, faces = 0, label_differences = 0;
  double sum_squared_m2 = 0, max_m = 0;
};

class Stitcher {
 public:
  Stitcher(const TilePackage& package, const std::vector<TileResult>& results, const TileBlend& blend)
      : package_(package), results_(results), blend_(blend) {}

  Status BlendVertices(TileCore* core, SeamResidual* seam) const;
  Status BlendFaces(TileCore* core, SeamResidual* seam) const;

 private:
  const TilePackage& package_;
  const std::vector<TileResult>& results_;
  const TileBlend& blend_;
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
    TESSERA_ASSIGN_OR_RETURN(const std::vector<TileBlend::Share> shares, blend_.OfVertex(id, start));
    const auto position = [&](const TileBlend::Share& s) { return results_[s.result].positions[s.index]; };
    for (size_t i = 1; i < shares.size(); ++i) {
      const double difference_m = (position(shares[i]) - position(shares[0])).norm();
      ++seam->vertices;
      seam->sum_squared_m2 += difference_m * difference_m;
      seam->max_m = std::max(seam->max_m, difference_m);
    }
    core->vertex_ids.push_back(id);
    core->positions.push_back(BlendedPosition(shares, position));
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
    TESSERA_ASSIGN_OR_RETURN(const std::vector<TileBlend::Share> shares,
                             blend_.OfFace(id, MeshSpans(package_.mesh).Centroid(f)));
    std::vector<double> sum(classes, 0.0);
    double total = 0;
    bool is_seen = false;
    const auto label = [&](const TileBlend::Share& s) { return results_[s.result].labels[s.index]; };
    const int32_t first_label = label(shares[0]);
    for (size_t i = 0; i < shares.size(); ++i) {
      const auto& [r, at, weight] = shares[i];
      seam->faces += i > 0;
      seam->label_differences += label(shares[i]) != first_label;
      total += weight;
      is_seen |= results_[r].seen[at] != 0;
      for (int l = 0; l < classes; ++l) sum[l] += weight * results_[r].beliefs[static_cast<size_t>(at) * classes + l];
    }
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
  for (const TileResult& result : results) {
    if (result.tile == package.tile) own = &result;
    if (result.beliefs.empty() && !result.face_ids.empty()) {
      return absl::DataLossError("tile " + std::to_string(result.tile) + ": the result is not of the last step");
    }
  }
  if (own == nullptr) return absl::DataLossError("tile " + std::to_string(package.tile) + ": found no own result");
  TESSERA_ASSIGN_OR_RETURN(const TileBlend blend,
                           TileBlend::Create(package.tile, static_cast<int>(package.classes.size()), package.ground,
                                             parameters.blend_m, results, parameters.results));

  TileCore core;
  core.tile = package.tile;
  SeamResidual seam;
  const Stitcher stitcher(package, results, blend);
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
