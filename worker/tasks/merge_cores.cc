#include "worker/tasks/merge_cores.h"

#include <cstring>

namespace tessera {
namespace {

bool SameBytes(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::memcmp(a.data(), b.data(), 3 * sizeof(double)) == 0;
}

Status Misfit(int tile, const std::string& what, uint32_t id, const std::string& fault) {
  return absl::DataLossError("core of tile " + std::to_string(tile) + ": " + what + " " + std::to_string(id) + " " +
                             fault);
}

}  // namespace

CoreMerger::CoreMerger(const City& city)
    : city_(city),
      confidence_(city.mesh.faces.size(), 0.0f),
      tile_of_face_(city.mesh.faces.size(), -1),
      tile_of_vertex_(city.mesh.vertices.size(), -1) {
  mesh_ = city.mesh;
}

Status CoreMerger::Add(const TileCore& core) {
  for (size_t i = 0; i < core.vertex_ids.size(); ++i) {
    const uint32_t v = core.vertex_ids[i];
    if (v >= tile_of_vertex_.size()) return Misfit(core.tile, "vertex", v, "is not in the city");
    if (tile_of_vertex_[v] >= 0 && !SameBytes(mesh_.vertices[v], core.positions[i])) {
      return Misfit(core.tile, "vertex", v, "differs from tile " + std::to_string(tile_of_vertex_[v]) + "'s");
    }
    tile_of_vertex_[v] = core.tile;
    mesh_.vertices[v] = core.positions[i];
  }
  for (size_t i = 0; i < core.face_ids.size(); ++i) {
    const uint32_t f = core.face_ids[i];
    if (f >= tile_of_face_.size()) return Misfit(core.tile, "face", f, "is not in the city");
    if (tile_of_face_[f] >= 0) {
      return Misfit(core.tile, "face", f, "is in the core of tile " + std::to_string(tile_of_face_[f]) + " too");
    }
    tile_of_face_[f] = core.tile;
    mesh_.labels[f] = core.labels[i];
    confidence_[f] = core.confidence[i];
  }
  return absl::OkStatus();
}

Status CoreMerger::Finish() {
  for (size_t f = 0; f < tile_of_face_.size(); ++f) {
    if (tile_of_face_[f] < 0) return absl::DataLossError("face " + std::to_string(f) + " is in no tile's core");
    for (const uint32_t v : mesh_.faces[f]) {
      if (tile_of_vertex_[v] < 0) return absl::DataLossError("vertex " + std::to_string(v) + " is in no tile's core");
    }
  }
  return absl::OkStatus();
}

}  // namespace tessera
