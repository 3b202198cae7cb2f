#include "common/geometry/welds.h"

#include <algorithm>
#include <cmath>
#include <compare>

#include "common/geometry/parent_links.h"

namespace tessera {
namespace {

constexpr size_t kEdgeSamples = 1 << 16;
constexpr double kFloatRounding = 0x1p-24, kRoundings = 4, kLargestShareOfEdge = 1e-3;

// 0: no two positions are at the same place.
double Tolerance(const MeshSpans& mesh) {
  double largest = 0;
  for (const Eigen::Vector3d& p : mesh.vertices) largest = std::max(largest, p.cwiseAbs().maxCoeff());
  std::vector<double> edges;
  const size_t step = std::max<size_t>(1, mesh.faces.size() / kEdgeSamples);
  for (size_t f = 0; f < mesh.faces.size(); f += step) {
    const double edge = (mesh.Corner(f, 1) - mesh.Corner(f, 0)).norm();
    if (edge > 0) edges.push_back(edge);
  }
  if (edges.empty()) return 0;
  const auto middle = edges.begin() + static_cast<std::ptrdiff_t>(edges.size() / 2);
  std::nth_element(edges.begin(), middle, edges.end());
  const double tolerance = std::min(kRoundings * kFloatRounding * largest, kLargestShareOfEdge * *middle);
  return tolerance > 0 ? std::exp2(std::floor(std::log2(tolerance))) : 0;
}

// Some vertices, grouped by place.
class Places {
 public:
  Places(const MeshSpans& mesh, std::vector<uint32_t> vertices, double tolerance) : vertices_(std::move(vertices)) {
    std::sort(vertices_.begin(), vertices_.end());
    vertices_.erase(std::unique(vertices_.begin(), vertices_.end()), vertices_.end());
    struct Entry {
      Cell cell;
      uint32_t index;  // in vertices_
      auto operator<=>(const Entry&) const = default;
    };
    std::vector<Entry> entries;
    for (uint32_t i = 0; i < vertices_.size(); ++i) {
      const Eigen::Vector3d cell = (mesh.vertices[vertices_[i]] / (tolerance / 2)).array().floor();
      entries.push_back({{cell.x(), cell.y(), cell.z()}, i});
    }
    std::sort(entries.begin(), entries.end());
    std::vector<Cell> cells;
    place_.resize(vertices_.size());
    for (const Entry& entry : entries) {
      if (cells.empty() || cells.back() != entry.cell) cells.push_back(entry.cell);
      place_[entry.index] = static_cast<uint32_t>(cells.size() - 1);
    }
    ParentLinks links(cells.size());
    for (uint32_t i = 0; i < cells.size(); ++i) JoinNeighbours(cells, i, &links);
    for (uint32_t& place : place_) place = links.Find(place);
  }

  // Of one of the vertices.
  uint32_t Of(uint32_t vertex) const {
    return place_[static_cast<size_t>(std::lower_bound(vertices_.begin(), vertices_.end(), vertex) -
                                      vertices_.begin())];
  }

 private:
  using Cell = std::array<double, 3>;  // whole numbers

  // Half of the neighbours: the others join this cell.
  static void JoinNeighbours(const std::vector<Cell>& cells, uint32_t i, ParentLinks* links) {
    const Cell& cell = cells[i];
    for (int x = 0; x <= 1; ++x) {
      for (int y = x == 0 ? 0 : -1; y <= 1; ++y) {
        // The cells of one x and y are neighbours in the order of cells.
        const Cell first = {cell[0] + x, cell[1] + y, cell[2] - 1};
        for (auto it = std::lower_bound(cells.begin() + (x == 0 && y == 0 ? i + 1 : 0), cells.end(), first);
             it != cells.end() && (*it)[0] == first[0] && (*it)[1] == first[1] && (*it)[2] <= cell[2] + 1; ++it) {
          links->Join(i, static_cast<uint32_t>(it - cells.begin()));
        }
      }
    }
  }

  std::vector<uint32_t> vertices_;
  std::vector<uint32_t> place_;  // of each of vertices_
};

}  // namespace

std::vector<CoincidentEdges> FindCoincidentEdges(const MeshSpans& mesh, std::span<const uint64_t> open_edges) {
  std::vector<CoincidentEdges> out;
  const double tolerance = open_edges.size() < 2 ? 0 : Tolerance(mesh);
  if (tolerance == 0) return out;
  const auto vertex = [&](uint64_t corner, int step) {
    return mesh.faces[corner / 3][(corner % 3 + static_cast<uint64_t>(step)) % 3];
  };
  std::vector<uint32_t> ends;
  for (const uint64_t corner : open_edges) {
    for (const int step : {0, 1}) ends.push_back(vertex(corner, step));
  }
  const Places places(mesh, std::move(ends), tolerance);
  struct Edge {
    uint32_t low, high;  // places
    uint64_t corner;
    auto operator<=>(const Edge&) const = default;
  };
  std::vector<Edge> edges;
  for (const uint64_t corner : open_edges) {
    const uint32_t a = places.Of(vertex(corner, 0)), b = places.Of(vertex(corner, 1));
    if (a != b) edges.push_back({std::min(a, b), std::max(a, b), corner});
  }
  std::sort(edges.begin(), edges.end());
  for (size_t begin = 0, end; begin < edges.size(); begin = end) {
    end = begin + 1;
    while (end < edges.size() && edges[end].low == edges[begin].low && edges[end].high == edges[begin].high) ++end;
    if (end - begin != 2) continue;
    const uint64_t a = edges[begin].corner, b = edges[begin + 1].corner;
    if (a / 3 == b / 3) continue;
    // Two faces with three corners at the same places are the sides of a sheet: welding would remove one of them.
    const Eigen::Vector3d between = mesh.vertices[vertex(a, 2)] - mesh.vertices[vertex(b, 2)];
    if (between.cwiseAbs().maxCoeff() <= tolerance) continue;
    const bool same = places.Of(vertex(a, 0)) == places.Of(vertex(b, 0));
    out.push_back({{static_cast<uint32_t>(a / 3), static_cast<uint32_t>(b / 3)},
                   {vertex(a, 0), vertex(b, same ? 0 : 1)},
                   {vertex(a, 1), vertex(b, same ? 1 : 0)},
                   same});
  }
  return out;
}

std::vector<std::pair<uint32_t, uint32_t>> VerticesToMerge(std::span<const CoincidentEdges> edges) {
  std::vector<uint32_t> vertices;
  for (const CoincidentEdges& e : edges) vertices.insert(vertices.end(), {e.from[0], e.from[1], e.to[0], e.to[1]});
  std::sort(vertices.begin(), vertices.end());
  vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
  const auto index = [&](uint32_t vertex) {
    return static_cast<uint32_t>(std::lower_bound(vertices.begin(), vertices.end(), vertex) - vertices.begin());
  };
  ParentLinks links(vertices.size());
  for (const CoincidentEdges& e : edges) {
    links.Join(index(e.from[0]), index(e.from[1]));
    links.Join(index(e.to[0]), index(e.to[1]));
  }
  std::vector<std::pair<uint32_t, uint32_t>> out;
  for (uint32_t i = 0; i < vertices.size(); ++i) {
    if (const uint32_t lowest = links.Find(i); lowest != i) out.emplace_back(vertices[i], vertices[lowest]);
  }
  return out;
}

}  // namespace tessera
