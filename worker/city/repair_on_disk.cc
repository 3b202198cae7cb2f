#include <algorithm>
#include <numeric>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/geometry/repair.h"
#include "worker/city/disk_mesh.h"

namespace tessera {
namespace {

using Corner = uint64_t;  // 3 face + k, in the whole mesh

// The repairs to apply, collected over all parts.
struct RepairPlan {
  std::vector<uint32_t> removed_faces;           // degenerate faces
  std::vector<uint32_t> dropped;                 // vertices without faces
  std::vector<Corner> copies;                    // duplicated vertices: the lowest corner of each fan that gets a copy
  std::vector<std::pair<Corner, Corner>> moved;  // corners that refer to a copy now, and that copy
  bool empty() const { return removed_faces.empty() && dropped.empty() && copies.empty(); }
};

// Receives the edges of all parts.
struct EdgeSink {
  FaceOrientation* orientation;  // joins the faces of edges with two faces
  std::vector<Corner>* open_edges;
};

void AddCount(const DefectCount& part, int64_t first_in_mesh, DefectCount* whole) {
  if (part.count == 0) return;
  whole->first = whole->count == 0 ? first_in_mesh : std::min(whole->first, first_in_mesh);
  whole->count += part.count;
}

// The vertices [begin, end) and all their incident faces as a mesh of its own, in the order of the whole mesh.
// Whether a vertex is manifold depends only on its incident faces, so parts can be analysed one by one; each part
// reports defects of its own vertices only, so nothing is counted twice.
class Part {
 public:
  // `dropped`: faces that count as removed, ascending.
  Part(const MeshSpans& mesh, size_t begin, size_t end, std::span<const uint32_t> face_ids,
       std::span<const uint32_t> dropped)
      : face_ids_(face_ids) {
    for (uint32_t f = 0; !dropped.empty() && f < face_ids.size(); ++f) {
      if (std::binary_search(dropped.begin(), dropped.end(), face_ids[f])) dropped_.push_back(f);
    }
    for (size_t v = begin; v < end; ++v) vertex_ids_.push_back(static_cast<uint32_t>(v));
    for (const uint32_t f : face_ids) {
      for (const uint32_t v : mesh.faces[f]) {
        if (v < begin || v >= end) vertex_ids_.push_back(v);
      }
    }
    std::sort(vertex_ids_.begin(), vertex_ids_.end());
    vertex_ids_.erase(std::unique(vertex_ids_.begin(), vertex_ids_.end()), vertex_ids_.end());
    owned_begin_ = Local(static_cast<uint32_t>(begin));
    owned_end_ = owned_begin_ + (end - begin);
    for (const uint32_t v : vertex_ids_) mesh_.vertices.push_back(mesh.vertices[v]);
    for (const uint32_t f : face_ids) {
      Triangle& face = mesh_.faces.emplace_back();
      for (int k = 0; k < 3; ++k) {
        const uint32_t v = mesh.faces[f][k];
        const bool owned = v >= begin && v < end;
        face[k] = static_cast<uint32_t>(owned ? owned_begin_ + (v - begin) : Local(v));
      }
    }
  }

  // `edges` may be null.
  Status Analyse(RepairPlan* plan, EdgeSink* edges, MeshDefects* defects) const {
    TESSERA_ASSIGN_OR_RETURN(const MeshAnalysis found, AnalyseMeshPart(mesh_, owned_begin_, owned_end_, dropped_));
    const MeshDefects& d = found.defects;
    const auto face = [&](const DefectCount& c) { return c.first < 0 ? -1 : int64_t{face_ids_[c.first]}; };
    const auto vertex = [&](const DefectCount& c) { return c.first < 0 ? -1 : int64_t{vertex_ids_[c.first]}; };
    AddCount(d.repeated_vertex_faces, face(d.repeated_vertex_faces), &defects->repeated_vertex_faces);
    AddCount(d.zero_area_faces, face(d.zero_area_faces), &defects->zero_area_faces);
    AddCount(d.duplicate_faces, face(d.duplicate_faces), &defects->duplicate_faces);
    AddCount(d.non_manifold_edges, vertex(d.non_manifold_edges), &defects->non_manifold_edges);
    AddCount(d.conflicting_edges, vertex(d.conflicting_edges), &defects->conflicting_edges);
    AddCount(d.non_manifold_vertices, vertex(d.non_manifold_vertices), &defects->non_manifold_vertices);
    AddCount(d.unreferenced_vertices, vertex(d.unreferenced_vertices), &defects->unreferenced_vertices);
    defects->boundary_edges += d.boundary_edges;

    const auto owned = [&](uint32_t v) { return v >= owned_begin_ && v < owned_end_; };
    constexpr uint32_t kNone = UINT32_MAX;
    std::vector<uint32_t> first_fan(mesh_.vertices.size(), kNone);
    for (uint32_t corner = 0; corner < found.fan_of_corner.size(); ++corner) {
      const Triangle& vertices = mesh_.faces[corner / 3];
      if (found.is_degenerate[corner / 3] != 0) {
        // Each face is reported by one of its parts only.
        if (corner % 3 == 0 && owned(*std::min_element(vertices.begin(), vertices.end()))) {
          plan->removed_faces.push_back(face_ids_[corner / 3]);
        }
        continue;
      }
      const uint32_t v = vertices[corner % 3], fan = found.fan_of_corner[corner];
      if (!owned(v)) continue;
      if (first_fan[v] == kNone) first_fan[v] = fan;  // corners are in order: the lowest of the vertex
      if (fan == first_fan[v]) continue;
      if (fan == corner) plan->copies.push_back(InMesh(corner));
      plan->moved.emplace_back(InMesh(corner), InMesh(fan));
    }
    for (size_t v = owned_begin_; v < owned_end_; ++v) {
      if (first_fan[v] == kNone) plan->dropped.push_back(vertex_ids_[v]);
    }
    if (edges == nullptr) return absl::OkStatus();
    const auto start = [&](uint32_t corner) { return mesh_.faces[corner / 3][corner % 3]; };
    for (const uint32_t corner : found.open_edges) edges->open_edges->push_back(InMesh(corner));
    for (const auto& [a, b] : found.paired_edges) {
      edges->orientation->Join(face_ids_[a / 3], face_ids_[b / 3], start(a) == start(b));
    }
    return absl::OkStatus();
  }

 private:
  size_t Local(uint32_t vertex) const {
    return static_cast<size_t>(std::lower_bound(vertex_ids_.begin(), vertex_ids_.end(), vertex) - vertex_ids_.begin());
  }
  Corner InMesh(uint32_t corner) const { return Corner{3} * face_ids_[corner / 3] + corner % 3; }

  std::span<const uint32_t> face_ids_;
  std::vector<uint32_t> dropped_;  // indices in face_ids_
  std::vector<uint32_t> vertex_ids_;
  size_t owned_begin_ = 0, owned_end_ = 0;
  TriangleMesh mesh_;
};

StatusOr<DiskMesh> ApplyRepair(const DiskMesh& mesh, RepairPlan plan, const std::string& scratch_folder) {
  std::sort(plan.removed_faces.begin(), plan.removed_faces.end());
  std::sort(plan.copies.begin(), plan.copies.end());
  std::sort(plan.moved.begin(), plan.moved.end());
  DiskMesh out;
  out.float_positions = mesh.float_positions;
  out.largest_coordinate_m = mesh.largest_coordinate_m;
  const size_t kept = mesh.vertices.size() - plan.dropped.size();
  TESSERA_ASSIGN_OR_RETURN(auto new_id, ScratchArray<uint32_t>::Create(scratch_folder, mesh.vertices.size()));
  TESSERA_ASSIGN_OR_RETURN(out.vertices,
                           ScratchArray<Eigen::Vector3d>::Create(scratch_folder, kept + plan.copies.size()));
  size_t next = 0;
  auto dropped = plan.dropped.begin();  // ascending, since parts are
  for (size_t v = 0; v < mesh.vertices.size(); ++v) {
    if (dropped != plan.dropped.end() && *dropped == v) {
      ++dropped;
      continue;
    }
    new_id[v] = static_cast<uint32_t>(next);
    out.vertices[next++] = mesh.vertices[v];
  }
  for (const Corner corner : plan.copies) {
    out.vertices[next++] = mesh.vertices[mesh.faces[corner / 3][corner % 3]];
  }

  const size_t faces = mesh.faces.size() - plan.removed_faces.size();
  TESSERA_ASSIGN_OR_RETURN(out.faces, ScratchArray<Triangle>::Create(scratch_folder, faces));
  TESSERA_ASSIGN_OR_RETURN(out.input_face, ScratchArray<uint32_t>::Create(scratch_folder, faces));
  if (mesh.labels.size() > 0) {
    TESSERA_ASSIGN_OR_RETURN(out.labels, ScratchArray<int32_t>::Create(scratch_folder, faces));
  }
  auto removed = plan.removed_faces.begin();
  auto moved = plan.moved.begin();
  size_t to = 0;
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    if (removed != plan.removed_faces.end() && *removed == f) {
      ++removed;
      continue;
    }
    Triangle face;
    for (size_t k = 0; k < 3; ++k) {
      face[k] = new_id[mesh.faces[f][k]];
      while (moved != plan.moved.end() && moved->first < 3 * f + k) ++moved;
      if (moved == plan.moved.end() || moved->first != 3 * f + k) continue;
      const auto copy = std::lower_bound(plan.copies.begin(), plan.copies.end(), moved->second);
      face[k] = static_cast<uint32_t>(kept + static_cast<size_t>(copy - plan.copies.begin()));
    }
    out.faces[to] = face;
    out.input_face[to] = static_cast<uint32_t>(f);
    if (mesh.labels.size() > 0) out.labels[to] = mesh.labels[f];
    ++to;
  }
  return out;
}

// Analyses the mesh part by part. `edges` may be null.
StatusOr<RepairPlan> AnalyseParts(const MeshSpans& spans, size_t size, std::span<const uint32_t> dropped,
                                  const std::string& scratch_folder, EdgeSink* edges, MeshDefects* defects) {
  const size_t parts = (spans.vertices.size() + size - 1) / size;
  // Sort the faces by part. A face is in up to three parts.
  const auto for_each_part = [&](const Triangle& face, const auto& visit) {
    const size_t a = face[0] / size, b = face[1] / size, c = face[2] / size;
    visit(a);
    if (b != a) visit(b);
    if (c != a && c != b) visit(c);
  };
  std::vector<size_t> ends(parts + 1, 0);
  for (const Triangle& face : spans.faces) for_each_part(face, [&](size_t part) { ++ends[part + 1]; });
  std::partial_sum(ends.begin(), ends.end(), ends.begin());
  TESSERA_ASSIGN_OR_RETURN(auto faces_of, ScratchArray<uint32_t>::Create(scratch_folder, ends.back()));
  std::vector<size_t> next(ends.begin(), ends.end() - 1);
  for (size_t f = 0; f < spans.faces.size(); ++f) {
    for_each_part(spans.faces[f], [&](size_t part) { faces_of[next[part]++] = static_cast<uint32_t>(f); });
  }
  RepairPlan plan;
  for (size_t p = 0; p < parts; ++p) {
    const Part part(spans, p * size, std::min((p + 1) * size, spans.vertices.size()),
                    std::span<const uint32_t>(faces_of.values()).subspan(ends[p], ends[p + 1] - ends[p]), dropped);
    TESSERA_RETURN_IF_ERROR(part.Analyse(&plan, edges, defects));
  }
  return plan;
}

}  // namespace

StatusOr<DiskMesh> RepairOnDisk(DiskMesh mesh, const std::string& scratch_folder, const DiskPassOptions& options,
                                const RepairOptions& repair, MeshDefects* defects) {
  const size_t size = options.vertices_per_part;
  MeshDefects before, at_cut;
  TESSERA_ASSIGN_OR_RETURN(const std::vector<uint32_t> stray,
                           DropStrayFaces(repair, mesh.vertices.values(), mesh.faces.values(), &before));
  TESSERA_ASSIGN_OR_RETURN(auto links, ScratchArray<uint32_t>::Create(scratch_folder, mesh.faces.size()));
  FaceOrientation orientation(links.values());
  std::vector<Corner> open_edges;
  EdgeSink edges = {&orientation, &open_edges};
  TESSERA_ASSIGN_OR_RETURN(RepairPlan plan, AnalyseParts(mesh.spans(), size, stray, scratch_folder, &edges, &at_cut));
  before.unreferenced_vertices = at_cut.unreferenced_vertices;
  for (const uint32_t f : plan.removed_faces) orientation.Exclude(f);
  TESSERA_ASSIGN_OR_RETURN(const bool is_changed, WeldAndTurn(repair, mesh.vertices.values(), open_edges, &orientation,
                                                              mesh.faces.values(), &before));
  if (is_changed) {
    at_cut = MeshDefects();
    TESSERA_ASSIGN_OR_RETURN(plan, AnalyseParts(mesh.spans(), size, stray, scratch_folder, nullptr, &at_cut));
  }
  *defects = CombinedDefects(before, at_cut);
  if (plan.empty()) return mesh;
  return ApplyRepair(mesh, std::move(plan), scratch_folder);
}

}  // namespace tessera
