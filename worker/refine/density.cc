#include "worker/refine/density.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "common/base/parallel.h"
#include "common/geometry/edge_list.h"

namespace tessera {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int64_t kGrain = 1024;
constexpr uint32_t kNone = 0xffffffffu;

struct Edge {
  uint32_t low, high;
  bool operator==(const Edge&) const = default;
};

// Sorted unique edges of the mesh, and the three edges of each face (k: from corner k to k + 1).
struct EdgeTable {
  std::vector<Edge> edges;
  std::vector<std::array<uint32_t, 3>> of_face;
};

EdgeTable MakeEdges(const std::vector<Triangle>& faces) {
  EdgeTable table;
  table.of_face.resize(faces.size());
  for (const FaceSide& side : SortedSides(faces)) {
    const Edge edge = {side.a, side.b};
    if (table.edges.empty() || !(table.edges.back() == edge)) table.edges.push_back(edge);
    table.of_face[side.face_corner / 3][side.face_corner % 3] = static_cast<uint32_t>(table.edges.size() - 1);
  }
  return table;
}

// Sets the midpoint of the `open` edges to 0 whose projection is longer than the limit in a camera that sees both ends.
void MarkLongEdges(const std::vector<Vector3d>& vertices, const std::vector<Edge>& edges,
                   const std::vector<uint32_t>& open, const std::vector<PosedCamera>& cameras, double limit_px2,
                   std::vector<uint32_t>* midpoint) {
  std::vector<uint8_t> is_end(vertices.size(), 0);
  for (const uint32_t e : open) is_end[edges[e].low] = is_end[edges[e].high] = 1;
  std::vector<Vector2d> pixel(vertices.size());
  for (const PosedCamera& camera : cameras) {
    ParallelForEach(vertices.size(), kGrain, [&](int64_t v) {
      if (!is_end[v]) return;
      const Vector3d p = camera.Project(vertices[v]);
      pixel[v] = camera.InImage(p) ? Vector2d(p.head<2>()) : Vector2d::Constant(std::nan(""));
    });
    ParallelForEach(open.size(), kGrain, [&](int64_t i) {
      const Edge& edge = edges[open[i]];
      if ((pixel[edge.low] - pixel[edge.high]).squaredNorm() > limit_px2) (*midpoint)[open[i]] = 0;  // false for NaN
    });
  }
}

// Appends the parts of a face; mid[k] is the midpoint of edge k (kNone: not split).
void AppendParts(const Triangle& face, const std::array<uint32_t, 3>& mid, std::vector<Triangle>* out) {
  const int split = (mid[0] != kNone) + (mid[1] != kNone) + (mid[2] != kNone);
  if (split == 0) {
    out->push_back(face);
  } else if (split == 3) {
    out->push_back({face[0], mid[0], mid[2]});
    out->push_back({mid[0], face[1], mid[1]});
    out->push_back({mid[2], mid[1], face[2]});
    out->push_back({mid[0], mid[1], mid[2]});
  } else if (split == 1) {
    const int k = mid[0] != kNone ? 0 : mid[1] != kNone ? 1 : 2;
    const uint32_t a = face[k], b = face[(k + 1) % 3], c = face[(k + 2) % 3];
    out->push_back({a, mid[k], c});
    out->push_back({mid[k], b, c});
  } else {
    // Edge k from a to b is not split; c is opposite. The quadrilateral a, b, p, q is cut at the lower id of a and b.
    const int k = mid[0] == kNone ? 0 : mid[1] == kNone ? 1 : 2;
    const uint32_t a = face[k], b = face[(k + 1) % 3], c = face[(k + 2) % 3];
    const uint32_t p = mid[(k + 1) % 3], q = mid[(k + 2) % 3];
    out->push_back({q, p, c});
    if (a < b) {
      out->push_back({a, b, p});
      out->push_back({a, p, q});
    } else {
      out->push_back({a, b, q});
      out->push_back({b, p, q});
    }
  }
}

}  // namespace

SplitMesh SplitLargeFaces(const TriangleMesh& mesh, const std::vector<PosedCamera>& cameras,
                          const DensityOptions& options, const EdgeRule& rule) {
  SplitMesh out;
  out.mesh = mesh;
  out.parent_face.resize(mesh.faces.size());
  for (size_t f = 0; f < mesh.faces.size(); ++f) out.parent_face[f] = static_cast<uint32_t>(f);
  // Squared side of the equilateral triangle of the limit's area.
  const double limit_px2 = options.max_footprint_px2 * 4 / std::sqrt(3.0);

  uint32_t first_new = 0;  // vertices of the round before; no edge between earlier ones is to be halved
  for (int round = 0; round < options.max_rounds; ++round) {
    const EdgeTable table = MakeEdges(out.mesh.faces);
    std::vector<uint32_t> midpoint(table.edges.size(), kNone), open;
    for (uint32_t e = 0; e < table.edges.size(); ++e) {
      if (table.edges[e].high < first_new) continue;
      const std::optional<bool> decided = rule ? rule(table.edges[e].low, table.edges[e].high) : std::nullopt;
      if (!decided) open.push_back(e);
      if (decided && *decided) midpoint[e] = 0;
    }
    MarkLongEdges(out.mesh.vertices, table.edges, open, cameras, limit_px2, &midpoint);
    first_new = static_cast<uint32_t>(out.mesh.vertices.size());
    bool any = false;
    for (size_t e = 0; e < table.edges.size(); ++e) {
      if (midpoint[e] == kNone) continue;
      any = true;
      midpoint[e] = static_cast<uint32_t>(out.mesh.vertices.size());
      const Vector3d middle = 0.5 * (out.mesh.vertices[table.edges[e].low] + out.mesh.vertices[table.edges[e].high]);
      out.mesh.vertices.push_back(middle);
      out.halved_edges.push_back({table.edges[e].low, table.edges[e].high});
    }
    if (!any) break;
    out.round_ends.push_back(out.halved_edges.size());
    std::vector<Triangle> faces;
    std::vector<int32_t> labels;
    std::vector<uint32_t> parents;
    faces.reserve(out.mesh.faces.size() * 2);
    for (size_t f = 0; f < out.mesh.faces.size(); ++f) {
      const std::array<uint32_t, 3>& edges = table.of_face[f];
      AppendParts(out.mesh.faces[f], {midpoint[edges[0]], midpoint[edges[1]], midpoint[edges[2]]}, &faces);
      parents.resize(faces.size(), out.parent_face[f]);
      if (!out.mesh.labels.empty()) labels.resize(faces.size(), out.mesh.labels[f]);
    }
    out.mesh.faces = std::move(faces);
    out.mesh.labels = std::move(labels);
    out.parent_face = std::move(parents);
  }
  return out;
}

}  // namespace tessera
