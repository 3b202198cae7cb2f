#include "common/geometry/mesh_defects.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>

#include <algorithm>
#include <array>
#include <compare>
#include <limits>
#include <numeric>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/geometry/parent_links.h"

namespace tessera {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;

constexpr int64_t kGrain = 1 << 14;

void Count(DefectCount& defect, int64_t index) {
  if (defect.count++ == 0) defect.first = index;
}

Kernel::Point_3 ToPoint(const Eigen::Vector3d& p) { return {p.x(), p.y(), p.z()}; }

// Exact predicate: true only if the area is exactly zero.
bool IsCollinear(const TriangleMesh& mesh, size_t face) {
  return CGAL::collinear(ToPoint(mesh.Corner(face, 0)), ToPoint(mesh.Corner(face, 1)), ToPoint(mesh.Corner(face, 2)));
}

// Items grouped by their lowest vertex: one sorted bucket per vertex.
template <class Item>
struct Buckets {
  std::vector<int64_t> offsets;
  std::vector<Item> items;
};

// Builds the buckets. emit(face, add) calls add(vertex, item) for each item of `face`.
template <class Item, class Emit>
Buckets<Item> SortIntoBuckets(const TriangleMesh& mesh, const Emit& emit) {
  Buckets<Item> out;
  out.offsets.assign(mesh.vertices.size() + 1, 0);
  for (size_t f = 0; f < mesh.faces.size(); ++f) emit(f, [&](uint32_t v, const Item&) { ++out.offsets[v + 1]; });
  std::partial_sum(out.offsets.begin(), out.offsets.end(), out.offsets.begin());
  out.items.resize(static_cast<size_t>(out.offsets.back()));
  std::vector<int64_t> next(out.offsets.begin(), out.offsets.end() - 1);
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    emit(f, [&](uint32_t v, const Item& item) { out.items[static_cast<size_t>(next[v]++)] = item; });
  }
  ParallelForEach(mesh.vertices.size(), kGrain, [&](size_t v) {
    std::sort(out.items.begin() + out.offsets[v], out.items.begin() + out.offsets[v + 1]);
  });
  return out;
}

struct Owned {
  size_t begin, end;
  bool Has(size_t vertex) const { return vertex >= begin && vertex < end; }
};

void FindDegenerateFaces(const TriangleMesh& mesh, const Owned& owned, std::span<const uint32_t> dropped,
                         MeshAnalysis& out) {
  enum : uint8_t { kGood, kRepeated, kZeroArea, kDuplicate, kDropped };
  std::vector<uint8_t>& kind = out.is_degenerate;
  kind.assign(mesh.faces.size(), kGood);
  ParallelForEach(mesh.faces.size(), kGrain, [&](size_t f) {
    const auto [a, b, c] = mesh.faces[f];
    if (a == b || b == c || c == a) {
      kind[f] = kRepeated;
    } else if (IsCollinear(mesh, f)) {
      kind[f] = kZeroArea;
    }
  });
  for (const uint32_t f : dropped) kind[f] = kDropped;
  struct Others {
    uint32_t middle, last, face;
    auto operator<=>(const Others&) const = default;
  };
  const auto buckets = SortIntoBuckets<Others>(mesh, [&](size_t f, const auto& add) {
    if (kind[f] != kGood) return;
    Triangle sorted = mesh.faces[f];
    std::sort(sorted.begin(), sorted.end());
    add(sorted[0], Others{sorted[1], sorted[2], static_cast<uint32_t>(f)});
  });
  for (size_t v = 0; v < mesh.vertices.size(); ++v) {
    for (int64_t i = buckets.offsets[v] + 1; i < buckets.offsets[v + 1]; ++i) {
      const Others& before = buckets.items[static_cast<size_t>(i - 1)];
      const Others& here = buckets.items[static_cast<size_t>(i)];
      if (before.middle == here.middle && before.last == here.last) kind[here.face] = kDuplicate;
    }
  }
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    if (kind[f] == kGood || !owned.Has(*std::min_element(mesh.faces[f].begin(), mesh.faces[f].end()))) continue;
    const auto index = static_cast<int64_t>(f);
    if (kind[f] == kRepeated) Count(out.defects.repeated_vertex_faces, index);
    if (kind[f] == kZeroArea) Count(out.defects.zero_area_faces, index);
    if (kind[f] == kDuplicate) Count(out.defects.duplicate_faces, index);
  }
}

// Joins the corners of adjacent faces across manifold edges only. A vertex with more than one resulting set is
// non-manifold, or lies on an edge that must be cut, so the sets are exactly the vertex copies that repair needs.
void FindFans(const TriangleMesh& mesh, const Owned& owned, std::span<const uint32_t> dropped, MeshAnalysis& out) {
  MeshDefects& defects = out.defects;
  // A face at an edge. The edge is stored in the bucket of its lower vertex.
  struct Side {
    uint32_t other;
    uint32_t corner;  // start corner of the face's directed edge
    auto operator<=>(const Side&) const = default;
  };
  const auto buckets = SortIntoBuckets<Side>(mesh, [&](size_t f, const auto& add) {
    if (out.is_degenerate[f] != 0) return;
    for (uint32_t k = 0; k < 3; ++k) {
      const uint32_t from = mesh.faces[f][k], to = mesh.faces[f][(k + 1) % 3];
      add(std::min(from, to), Side{std::max(from, to), static_cast<uint32_t>(3 * f + k)});
    }
  });
  const auto vertex_of = [&](uint32_t corner) { return mesh.faces[corner / 3][corner % 3]; };
  const auto next_corner = [](uint32_t corner) { return corner % 3 == 2 ? corner - 2 : corner + 1; };

  ParentLinks fans(3 * mesh.faces.size());
  std::vector<uint8_t> on_cut_edge(mesh.vertices.size(), 0);
  for (uint32_t v = 0; v < mesh.vertices.size(); ++v) {
    for (int64_t i = buckets.offsets[v]; i < buckets.offsets[v + 1];) {
      const Side* side = &buckets.items[static_cast<size_t>(i)];
      int64_t faces = 1;
      while (i + faces < buckets.offsets[v + 1] && side[faces].other == side->other) ++faces;
      i += faces;
      if (faces <= 2 && owned.Has(v)) {
        if (faces == 1) out.open_edges.push_back(side->corner);
        if (faces == 2) out.paired_edges.push_back({side[0].corner, side[1].corner});
      }
      if (faces == 1) {
        defects.boundary_edges += owned.Has(v);
      } else if (faces == 2 && vertex_of(side[0].corner) != vertex_of(side[1].corner)) {
        fans.Join(side[0].corner, next_corner(side[1].corner));
        fans.Join(side[1].corner, next_corner(side[0].corner));
      } else {
        if (owned.Has(v)) Count(faces == 2 ? defects.conflicting_edges : defects.non_manifold_edges, v);
        on_cut_edge[v] = on_cut_edge[side->other] = 1;
      }
    }
  }
  out.fan_of_corner = fans.Flattened();

  std::vector<uint32_t> fans_of_vertex(mesh.vertices.size(), 0);
  for (uint32_t corner = 0; corner < out.fan_of_corner.size(); ++corner) {
    if (out.is_degenerate[corner / 3] == 0 && out.fan_of_corner[corner] == corner) ++fans_of_vertex[vertex_of(corner)];
  }
  std::vector<uint8_t> is_dropped(dropped.empty() ? 0 : mesh.vertices.size(), 0);
  for (const uint32_t f : dropped) {
    for (const uint32_t v : mesh.faces[f]) is_dropped[v] = 1;
  }
  for (size_t v = owned.begin; v < owned.end; ++v) {
    if (!dropped.empty() && is_dropped[v] != 0) continue;
    if (fans_of_vertex[v] == 0) Count(defects.unreferenced_vertices, static_cast<int64_t>(v));
    if (fans_of_vertex[v] > 1 && on_cut_edge[v] == 0) Count(defects.non_manifold_vertices, static_cast<int64_t>(v));
  }
}

}  // namespace

bool MeshDefects::IsClean() const {
  return repeated_vertex_faces.count == 0 && zero_area_faces.count == 0 && duplicate_faces.count == 0 &&
         non_manifold_edges.count == 0 && conflicting_edges.count == 0 && non_manifold_vertices.count == 0 &&
         unreferenced_vertices.count == 0 && stray_vertices.count == 0 && welded_vertices.count == 0 &&
         turned_faces.count == 0;
}

Status CheckMeshArrays(const TriangleMesh& mesh) {
  if (mesh.faces.size() > std::numeric_limits<uint32_t>::max() / 3) {
    return absl::InvalidArgumentError(absl::StrCat("mesh has ", mesh.faces.size(), " faces, expected at most ",
                                                   std::numeric_limits<uint32_t>::max() / 3));
  }
  if (!mesh.labels.empty() && mesh.labels.size() != mesh.faces.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("mesh has ", mesh.labels.size(), " labels, expected one per face: ", mesh.faces.size()));
  }
  for (size_t v = 0; v < mesh.vertices.size(); ++v) {
    if (!mesh.vertices[v].allFinite()) return absl::InvalidArgumentError(absl::StrCat("vertex ", v, " is not finite"));
  }
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    for (const uint32_t vertex : mesh.faces[f]) {
      if (vertex >= mesh.vertices.size()) {
        return absl::InvalidArgumentError(
            absl::StrCat("face ", f, " has vertex index ", vertex, ", expected an index below ", mesh.vertices.size()));
      }
    }
  }
  return absl::OkStatus();
}

StatusOr<MeshAnalysis> AnalyseMesh(const TriangleMesh& mesh, std::span<const uint32_t> dropped) {
  return AnalyseMeshPart(mesh, 0, mesh.vertices.size(), dropped);
}

StatusOr<MeshAnalysis> AnalyseMeshPart(const TriangleMesh& mesh, size_t owned_begin, size_t owned_end,
                                       std::span<const uint32_t> dropped) {
  TESSERA_RETURN_IF_ERROR(CheckMeshArrays(mesh));
  const Owned owned = {owned_begin, owned_end};
  MeshAnalysis analysis;
  FindDegenerateFaces(mesh, owned, dropped, analysis);
  FindFans(mesh, owned, dropped, analysis);
  return analysis;
}

StatusOr<MeshDefects> CheckMesh(const TriangleMesh& mesh) {
  TESSERA_ASSIGN_OR_RETURN(const MeshAnalysis analysis, AnalyseMesh(mesh));
  return analysis.defects;
}

}  // namespace tessera
