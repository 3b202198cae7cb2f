#include "worker/tasks/regions.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <unordered_set>

#include "worker/tasks/tile_files.h"

namespace tessera {
namespace {

// Squares of the frame's x-y plane, so many metres wide; boxes that touch share one, or lie side by side in it.
class Squares {
 public:
  explicit Squares(double side_m) : side_m_(side_m) {}
  void Add(const Eigen::AlignedBox3d& box) {
    ForEach(box, [&](uint64_t key) { return marked_.insert(key), false; });
  }
  bool Meets(const Eigen::AlignedBox3d& box) const {
    return ForEach(box, [&](uint64_t key) { return marked_.contains(key); });
  }

 private:
  template <class Body>
  bool ForEach(const Eigen::AlignedBox3d& box, const Body& body) const {
    const auto at = [&](double x) { return static_cast<int32_t>(std::floor(x / side_m_)); };
    for (int32_t y = at(box.min().y()); y <= at(box.max().y()); ++y) {
      for (int32_t x = at(box.min().x()); x <= at(box.max().x()); ++x) {
        if (body(static_cast<uint64_t>(static_cast<uint32_t>(y)) << 32 | static_cast<uint32_t>(x))) return true;
      }
    }
    return false;
  }
  double side_m_;
  std::unordered_set<uint64_t> marked_;
};

Eigen::AlignedBox3d BoxOf(const TriangleMesh& mesh, size_t face) {
  Eigen::AlignedBox3d box;
  for (const uint32_t v : mesh.faces[face]) box.extend(mesh.vertices[v]);
  return box;
}

// Adds the faces that may touch one that has a flag.
void GrowContacts(const TriangleMesh& mesh, double contact_m, std::vector<uint8_t>* faces) {
  Squares squares(std::max(contact_m, 1e-3));
  const Eigen::Vector3d margin = Eigen::Vector3d::Constant(contact_m);
  for (size_t f = 0; f < faces->size(); ++f) {
    if (!(*faces)[f]) continue;
    const Eigen::AlignedBox3d box = BoxOf(mesh, f);
    squares.Add({box.min() - margin, box.max() + margin});
  }
  for (size_t f = 0; f < faces->size(); ++f) {
    if (!(*faces)[f] && squares.Meets(BoxOf(mesh, f))) (*faces)[f] = 1;
  }
}

std::vector<std::array<uint32_t, 2>> FaceLinks(const std::vector<Triangle>& faces) {
  std::vector<std::array<uint32_t, 2>> links;
  for (const MeshEdge& edge : EdgeList(faces)) {
    if (edge.left >= 0 && edge.right >= 0) {
      links.push_back({static_cast<uint32_t>(edge.left), static_cast<uint32_t>(edge.right)});
    }
  }
  return links;
}

}  // namespace

void GrowRing(const TriangleMesh& mesh, const IndexRows& faces_of_vertex, std::vector<uint8_t>* faces) {
  std::vector<uint8_t> touched(mesh.vertices.size(), 0);
  for (size_t f = 0; f < faces->size(); ++f) {
    if (!(*faces)[f]) continue;
    for (const uint32_t v : mesh.faces[f]) touched[v] = 1;
  }
  for (size_t v = 0; v < touched.size(); ++v) {
    if (!touched[v]) continue;
    for (const uint32_t f : faces_of_vertex[v]) (*faces)[f] = 1;
  }
}

std::vector<uint8_t> FindRegions(const TriangleMesh& mesh, const IndexRows& faces_of_vertex,
                                 const std::vector<Cell>& cell, const std::vector<uint8_t>& core,
                                 const RegionReach& reach) {
  // A ring of vertices is one of faces: a vertex at distance d has all its faces after d + 1 rings.
  std::vector<uint8_t> solve = core;
  for (int ring = 0; ring <= reach.solve_rings; ++ring) GrowRing(mesh, faces_of_vertex, &solve);
  std::vector<uint8_t> mend = core;
  GrowRing(mesh, faces_of_vertex, &mend);
  for (const int rings : reach.mend_rings) {
    for (int ring = 0; ring < rings; ++ring) GrowRing(mesh, faces_of_vertex, &mend);
    GrowContacts(mesh, reach.contact_m, &mend);
  }
  for (int ring = 0; ring < reach.mend_start_rings; ++ring) GrowRing(mesh, faces_of_vertex, &mend);
  const std::vector<uint8_t> label = FacesInReach(FaceLinks(mesh.faces), cell, core, reach.label);
  std::vector<uint8_t> regions(core.size());
  for (size_t f = 0; f < regions.size(); ++f) {
    regions[f] = static_cast<uint8_t>((core[f] ? kCoreRegion : 0) | (solve[f] ? kSolveRegion : 0) |
                                      (mend[f] ? kMendRegion : 0) | (label[f] ? kLabelRegion : 0));
  }
  return regions;
}

}  // namespace tessera
