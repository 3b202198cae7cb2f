#include "common/geometry/repair.h"

#include <limits>
#include <string>

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();

void Warn(const DefectCount& defect, const std::string& what, const std::string& first, Warnings* warnings) {
  if (defect.count == 0 || warnings == nullptr) return;
  warnings->push_back(absl::StrCat("mesh: ", defect.count, " ", what, " (first: ", first, " ", defect.first, ")"));
}

}  // namespace

void WarnOfDefects(const MeshDefects& defects, Warnings* warnings) {
  Warn(defects.repeated_vertex_faces, "faces with a repeated vertex removed", "face", warnings);
  Warn(defects.zero_area_faces, "faces with zero area removed", "face", warnings);
  Warn(defects.duplicate_faces, "duplicate faces removed", "face", warnings);
  Warn(defects.non_manifold_edges, "edges with more than two faces cut", "at vertex", warnings);
  Warn(defects.conflicting_edges, "edges between faces of opposite orientation cut", "at vertex", warnings);
  Warn(defects.non_manifold_vertices, "non-manifold vertices cut", "vertex", warnings);
  Warn(defects.unreferenced_vertices, "unreferenced vertices removed", "vertex", warnings);
}

// Cutting is local and needs no decision about the right surface, which makes the result unique: each fan of faces gets
// its own copy of a vertex, so every edge with inconsistent faces becomes boundary edges. The lowest fan keeps the
// original vertex, so that clean parts of the mesh keep their vertex order.
StatusOr<RepairedMesh> RepairMesh(const TriangleMesh& mesh, Warnings* warnings) {
  TESSERA_ASSIGN_OR_RETURN(MeshAnalysis analysis, AnalyseMesh(mesh));
  WarnOfDefects(analysis.defects, warnings);
  RepairedMesh out;
  out.defects = analysis.defects;

  const std::vector<uint32_t>& fan = analysis.fan_of_corner;
  const auto vertex_of = [&](uint32_t corner) { return mesh.faces[corner / 3][corner % 3]; };
  // The first fan of a vertex keeps it; each other fan gets a copy.
  std::vector<uint32_t> first_fan(mesh.vertices.size(), kNone);
  std::vector<uint32_t> other_fans;
  for (uint32_t corner = 0; corner < fan.size(); ++corner) {
    if (analysis.is_degenerate[corner / 3] != 0 || fan[corner] != corner) continue;
    uint32_t& first = first_fan[vertex_of(corner)];
    if (first == kNone) {
      first = corner;
    } else {
      other_fans.push_back(corner);
    }
  }
  std::vector<uint32_t> vertex_of_fan(fan.size(), kNone);
  const auto add_vertex = [&](uint32_t v, uint32_t corner) {
    vertex_of_fan[corner] = static_cast<uint32_t>(out.mesh.vertices.size());
    out.mesh.vertices.push_back(mesh.vertices[v]);
    out.vertex_in_input.push_back(v);
  };
  out.mesh.vertices.reserve(mesh.vertices.size() + other_fans.size());
  out.vertex_in_input.reserve(mesh.vertices.size() + other_fans.size());
  for (uint32_t v = 0; v < first_fan.size(); ++v) {
    if (first_fan[v] != kNone) add_vertex(v, first_fan[v]);
  }
  for (const uint32_t corner : other_fans) add_vertex(vertex_of(corner), corner);
  out.vertex_copies = static_cast<int64_t>(other_fans.size());

  out.mesh.faces.reserve(mesh.faces.size());
  out.face_in_input.reserve(mesh.faces.size());
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    if (analysis.is_degenerate[f] != 0) {
      out.removed_faces.push_back(static_cast<int64_t>(f));
      continue;
    }
    Triangle face;
    for (size_t k = 0; k < 3; ++k) face[k] = vertex_of_fan[fan[3 * f + k]];
    out.mesh.faces.push_back(face);
    out.face_in_input.push_back(static_cast<int64_t>(f));
    if (!mesh.labels.empty()) out.mesh.labels.push_back(mesh.labels[f]);
  }
  return out;
}

}  // namespace tessera
