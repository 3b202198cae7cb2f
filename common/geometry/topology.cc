#include "common/geometry/topology.h"

#include <OpenMesh/Core/Mesh/Traits.hh>
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <algorithm>
#include <limits>

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

struct DoubleTraits : OpenMesh::DefaultTraits {
  using Point = OpenMesh::Vec3d;
  using Normal = OpenMesh::Vec3d;
};
using HalfedgeMesh = OpenMesh::TriMesh_ArrayKernelT<DoubleTraits>;

Status NotManifold(const std::string& what) {
  return absl::InvalidArgumentError(absl::StrCat("mesh is not a manifold: ", what));
}

// Finds what would make OpenMesh refuse a face, before it is asked (it prints to the error stream).
Status CheckDirectedEdges(const TriangleMesh& mesh) {
  std::vector<int64_t> offsets(mesh.vertices.size() + 1, 0);
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const Triangle& face = mesh.faces[f];
    for (int k = 0; k < 3; ++k) {
      if (face[k] >= mesh.vertices.size()) return NotManifold(absl::StrCat("face ", f, " names vertex ", face[k]));
      if (face[k] == face[(k + 1) % 3]) return NotManifold(absl::StrCat("face ", f, " has vertex ", face[k], " twice"));
      ++offsets[face[k] + 1];
    }
  }
  for (size_t v = 0; v < mesh.vertices.size(); ++v) offsets[v + 1] += offsets[v];
  struct Outgoing {
    uint32_t to;
    uint32_t face;
    auto operator<=>(const Outgoing&) const = default;
  };
  std::vector<Outgoing> edges(3 * mesh.faces.size());
  std::vector<int64_t> next(offsets.begin(), offsets.end() - 1);
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const Triangle& face = mesh.faces[f];
    for (int k = 0; k < 3; ++k) edges[next[face[k]]++] = {face[(k + 1) % 3], static_cast<uint32_t>(f)};
  }
  for (size_t v = 0; v < mesh.vertices.size(); ++v) {
    std::sort(edges.begin() + offsets[v], edges.begin() + offsets[v + 1]);
    for (int64_t i = offsets[v] + 1; i < offsets[v + 1]; ++i) {
      if (edges[i].to == edges[i - 1].to) {
        return NotManifold(absl::StrCat("faces ", edges[i - 1].face, " and ", edges[i].face,
                                        " both have the edge from vertex ", v, " to ", edges[i].to));
      }
    }
  }
  return absl::OkStatus();
}

StatusOr<HalfedgeMesh> ToHalfedges(const TriangleMesh& mesh) {
  HalfedgeMesh out;
  out.reserve(mesh.vertices.size(), 3 * mesh.faces.size() / 2, mesh.faces.size());
  for (const Eigen::Vector3d& v : mesh.vertices) out.add_vertex({v.x(), v.y(), v.z()});
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const Triangle& face = mesh.faces[f];
    const auto handle = [](uint32_t v) { return OpenMesh::VertexHandle(static_cast<int>(v)); };
    if (!out.add_face(handle(face[0]), handle(face[1]), handle(face[2])).is_valid()) {
      return NotManifold(absl::StrCat("face ", f, " does not fit to the faces before it"));
    }
  }
  return out;
}

// The ring of `vertex` and its faces.
Status WalkRing(const HalfedgeMesh& mesh, OpenMesh::VertexHandle vertex, std::vector<uint32_t>& ring,
                std::vector<uint32_t>& faces) {
  ring.clear();
  faces.clear();
  OpenMesh::HalfedgeHandle start = mesh.halfedge_handle(vertex);
  if (!start.is_valid()) return absl::OkStatus();
  const auto turn_left = [&](OpenMesh::HalfedgeHandle h) {
    return mesh.opposite_halfedge_handle(mesh.prev_halfedge_handle(h));
  };
  // OpenMesh keeps a rim half-edge as the vertex's own: it has no face, so the fan begins after it.
  if (mesh.is_boundary(start)) start = turn_left(start);
  OpenMesh::HalfedgeHandle h = start;
  int rims = 0;
  do {
    ring.push_back(static_cast<uint32_t>(mesh.to_vertex_handle(h).idx()));
    if (mesh.is_boundary(h)) {
      ++rims;
    } else {
      faces.push_back(static_cast<uint32_t>(mesh.face_handle(h).idx()));
    }
    h = turn_left(h);
  } while (h != start);
  if (rims > 1) return NotManifold(absl::StrCat("the faces around vertex ", vertex.idx(), " form ", rims, " fans"));
  if (rims == 0) {
    const auto shift = std::min_element(ring.begin(), ring.end()) - ring.begin();
    std::rotate(ring.begin(), ring.begin() + shift, ring.end());
    std::rotate(faces.begin(), faces.begin() + shift, faces.end());
  }
  return absl::OkStatus();
}

void AppendRow(const std::vector<uint32_t>& row, IndexRows& rows) {
  rows.items.insert(rows.items.end(), row.begin(), row.end());
  rows.offsets.push_back(static_cast<int64_t>(rows.items.size()));
}

}  // namespace

StatusOr<MeshTopology> BuildTopology(const TriangleMesh& mesh) {
  // OpenMesh counts half-edges in an int.
  if (mesh.vertices.size() > std::numeric_limits<int32_t>::max() / 6 ||
      mesh.faces.size() > std::numeric_limits<int32_t>::max() / 6) {
    return absl::InvalidArgumentError("mesh is too large to be walked at once");
  }
  TESSERA_RETURN_IF_ERROR(CheckDirectedEdges(mesh));
  TESSERA_ASSIGN_OR_RETURN(const HalfedgeMesh halfedges, ToHalfedges(mesh));

  MeshTopology topology;
  topology.vertex_ring.offsets.reserve(mesh.vertices.size() + 1);
  topology.vertex_faces.offsets.reserve(mesh.vertices.size() + 1);
  topology.vertex_ring.items.reserve(3 * mesh.faces.size());
  topology.vertex_faces.items.reserve(3 * mesh.faces.size());
  std::vector<uint32_t> ring, faces;
  size_t corners = 0;
  for (const OpenMesh::VertexHandle vertex : halfedges.vertices()) {
    TESSERA_RETURN_IF_ERROR(WalkRing(halfedges, vertex, ring, faces));
    AppendRow(ring, topology.vertex_ring);
    AppendRow(faces, topology.vertex_faces);
    corners += faces.size();
  }
  // A fan that is closed in itself beside another one is not met from the vertex.
  if (corners != 3 * mesh.faces.size()) return NotManifold("a vertex joins fans that do not touch otherwise");

  topology.face_neighbours.resize(mesh.faces.size());
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    OpenMesh::HalfedgeHandle h = halfedges.halfedge_handle(OpenMesh::FaceHandle(static_cast<int>(f)));
    for (int i = 0; i < 3; ++i, h = halfedges.next_halfedge_handle(h)) {
      const auto from = static_cast<uint32_t>(halfedges.from_vertex_handle(h).idx());
      const Triangle& face = mesh.faces[f];
      const auto k = std::find(face.begin(), face.end(), from) - face.begin();
      topology.face_neighbours[f][k] = halfedges.face_handle(halfedges.opposite_halfedge_handle(h)).idx();
    }
  }
  return topology;
}

std::vector<MeshEdge> EdgeList(const std::vector<Triangle>& faces) {
  struct Side {
    uint32_t a, b;
    int32_t face;
    bool left;
  };
  std::vector<Side> sides;
  sides.reserve(3 * faces.size());
  for (size_t f = 0; f < faces.size(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const uint32_t from = faces[f][k], to = faces[f][(k + 1) % 3];
      sides.push_back({std::min(from, to), std::max(from, to), static_cast<int32_t>(f), from < to});
    }
  }
  std::sort(sides.begin(), sides.end(), [](const Side& x, const Side& y) {
    return x.a != y.a ? x.a < y.a : x.b != y.b ? x.b < y.b : x.face < y.face;
  });
  std::vector<MeshEdge> edges;
  edges.reserve(sides.size() / 2 + 1);
  for (const Side& side : sides) {
    if (edges.empty() || edges.back().a != side.a || edges.back().b != side.b)
      edges.push_back({side.a, side.b, -1, -1});
    (side.left ? edges.back().left : edges.back().right) = side.face;
  }
  return edges;
}

}  // namespace tessera
