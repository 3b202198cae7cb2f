#include "common/geometry/repair.h"

#include <algorithm>
#include <limits>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/geometry/welds.h"

namespace tessera {
namespace {

constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();
constexpr double kMaxStrayShare = 0.1;  // of the faces

void Warn(const DefectCount& defect, const std::string& what, const std::string& first, Warnings* warnings) {
  if (defect.count == 0 || warnings == nullptr) return;
  warnings->push_back(absl::StrCat("mesh: ", defect.count, " ", what, " (first: ", first, " ", defect.first, ")"));
}

// Cutting is local and needs no decision about the right surface, which makes the result unique: each fan of faces gets
// its own copy of a vertex, so every edge with inconsistent faces becomes boundary edges. The lowest fan keeps the
// original vertex, so that clean parts of the mesh keep their vertex order.
RepairedMesh Cut(const TriangleMesh& mesh, const MeshAnalysis& analysis, const MeshDefects& defects) {
  RepairedMesh out;
  out.defects = defects;

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

}  // namespace

void WarnOfDefects(const MeshDefects& defects, Warnings* warnings) {
  Warn(defects.stray_vertices,
       absl::StrCat("vertices far from all that the images show removed, with ", defects.stray_faces, " faces"),
       "vertex", warnings);
  Warn(defects.welded_vertices, "vertices on borders at the same place welded", "vertex", warnings);
  Warn(defects.turned_faces, "faces turned: they faced inwards or against their neighbours", "face", warnings);
  Warn(defects.repeated_vertex_faces, "faces with a repeated vertex removed", "face", warnings);
  Warn(defects.zero_area_faces, "faces with zero area removed", "face", warnings);
  Warn(defects.duplicate_faces, "duplicate faces removed", "face", warnings);
  Warn(defects.non_manifold_edges, "edges with more than two faces cut", "at vertex", warnings);
  Warn(defects.conflicting_edges, "edges between faces of opposite orientation cut", "at vertex", warnings);
  Warn(defects.non_manifold_vertices, "non-manifold vertices cut", "vertex", warnings);
  Warn(defects.unreferenced_vertices, "unreferenced vertices removed", "vertex", warnings);
  Warn(defects.small_pieces,
       "pieces of at most 100 faces are in fewer than two images, or smaller than 25 px: images cannot refine them",
       "face", warnings);
}

StatusOr<RepairedMesh> CutMesh(const TriangleMesh& mesh, Warnings* warnings) {
  TESSERA_ASSIGN_OR_RETURN(const MeshAnalysis analysis, AnalyseMesh(mesh));
  WarnOfDefects(analysis.defects, warnings);
  return Cut(mesh, analysis, analysis.defects);
}

StatusOr<RepairedMesh> RepairMesh(const TriangleMesh& mesh, const RepairOptions& options, Warnings* warnings) {
  TESSERA_RETURN_IF_ERROR(CheckMeshArrays(mesh));
  TriangleMesh changed = mesh;
  MeshDefects before;
  TESSERA_ASSIGN_OR_RETURN(const std::vector<uint32_t> stray,
                           DropStrayFaces(options, changed.vertices, changed.faces, &before));
  TESSERA_ASSIGN_OR_RETURN(MeshAnalysis analysis, AnalyseMesh(changed, stray));
  before.unreferenced_vertices = analysis.defects.unreferenced_vertices;
  std::vector<uint32_t> links(mesh.faces.size());
  FaceOrientation orientation(links);
  for (uint32_t f = 0; f < links.size(); ++f) {
    if (analysis.is_degenerate[f] != 0) orientation.Exclude(f);
  }
  const auto start = [&](uint32_t corner) { return changed.faces[corner / 3][corner % 3]; };
  for (const auto& [a, b] : analysis.paired_edges) orientation.Join(a / 3, b / 3, start(a) == start(b));
  const std::vector<uint64_t> open_edges(analysis.open_edges.begin(), analysis.open_edges.end());
  TESSERA_ASSIGN_OR_RETURN(const bool is_changed,
                           WeldAndTurn(options, changed.vertices, open_edges, &orientation, changed.faces, &before));
  if (is_changed) {
    TESSERA_ASSIGN_OR_RETURN(analysis, AnalyseMesh(changed, stray));
  }
  const MeshDefects defects = CombinedDefects(before, analysis.defects);
  WarnOfDefects(defects, warnings);
  return Cut(changed, analysis, defects);
}

StatusOr<std::vector<uint32_t>> DropStrayFaces(const RepairOptions& options, std::span<Eigen::Vector3d> vertices,
                                               std::span<Triangle> faces, MeshDefects* defects) {
  const StrayFaces stray = FindStrayFaces(MeshSpans(vertices, faces), options.views, options.file_origin);
  if (stray.faces.empty()) return std::vector<uint32_t>();
  const double share = static_cast<double>(stray.faces.size()) / static_cast<double>(faces.size());
  if (share > kMaxStrayShare) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%sfound %d of %d faces with a vertex far from all that the images show (first: vertex %d), expected at most "
        "%g %%: check the mesh's unit, origin and extent",
        options.file.empty() ? "" : options.file + ": ", stray.faces.size(), faces.size(), stray.vertices.front(),
        100 * kMaxStrayShare));
  }
  defects->stray_vertices = {static_cast<int64_t>(stray.vertices.size()), int64_t{stray.vertices.front()}};
  defects->stray_faces = static_cast<int64_t>(stray.faces.size());
  CollapseStrayFaces(stray, options.views, vertices, faces);
  return stray.faces;
}

StatusOr<bool> WeldAndTurn(const RepairOptions& options, std::span<const Eigen::Vector3d> vertices,
                           std::span<const uint64_t> open_edges, FaceOrientation* orientation,
                           std::span<Triangle> faces, MeshDefects* defects) {
  const MeshSpans mesh(vertices, faces);
  std::vector<CoincidentEdges> edges = FindCoincidentEdges(mesh, open_edges);
  for (const CoincidentEdges& e : edges) orientation->Join(e.faces[0], e.faces[1], e.same_direction);
  TESSERA_ASSIGN_OR_RETURN(
      const FaceOrientation::Result decided,
      orientation->Decide(mesh, options.views, options.scratch_folder, options.max_faces_for_rays));
  std::erase_if(edges, [&](const CoincidentEdges& e) {
    return (orientation->IsTurned(e.faces[0]) != orientation->IsTurned(e.faces[1])) != e.same_direction;
  });
  const std::vector<std::pair<uint32_t, uint32_t>> merged = VerticesToMerge(edges);
  defects->turned_faces = decided.turned_faces;
  defects->small_pieces = decided.small_pieces;
  if (!merged.empty()) defects->welded_vertices = {static_cast<int64_t>(merged.size()), int64_t{merged.front().first}};
  if (merged.empty() && decided.turned_faces.count == 0) return false;
  for (uint32_t f = 0; f < faces.size(); ++f) {
    for (uint32_t& v : faces[f]) {
      const auto it = std::lower_bound(merged.begin(), merged.end(), std::pair<uint32_t, uint32_t>(v, 0));
      if (it != merged.end() && it->first == v) v = it->second;
    }
    if (orientation->IsTurned(f)) std::swap(faces[f][1], faces[f][2]);
  }
  return true;
}

MeshDefects CombinedDefects(const MeshDefects& before, const MeshDefects& at_cut) {
  MeshDefects defects = at_cut;
  defects.unreferenced_vertices = before.unreferenced_vertices;  // welding adds others
  defects.stray_vertices = before.stray_vertices;
  defects.stray_faces = before.stray_faces;
  defects.welded_vertices = before.welded_vertices;
  defects.turned_faces = before.turned_faces;
  defects.small_pieces = before.small_pieces;
  return defects;
}

}  // namespace tessera
