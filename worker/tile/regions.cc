#include "worker/tile/regions.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "worker/tile/tile_files.h"

namespace tessera {
namespace {

// A grid of squares in the frame's x-y plane. Boxes that touch share a square. A uniform grid suffices, because faces
// are small and similar in size after splitting; its size adapts to outliers below.
class Squares {
 public:
  // Side of the squares: the root of the boxes' mean squared extent, so that a box covers few squares, or more if the
  // boxes are far apart, to limit the number of squares.
  explicit Squares(const std::vector<Eigen::AlignedBox3d>& boxes) {
    Eigen::AlignedBox2d all;
    double sum = 0;
    for (const Eigen::AlignedBox3d& box : boxes) {
      all.extend(Eigen::Vector2d(box.min().head<2>())).extend(Eigen::Vector2d(box.max().head<2>()));
      sum += box.sizes().head<2>().squaredNorm();
    }
    if (boxes.empty()) return;
    const double count = static_cast<double>(boxes.size()), longest = all.sizes().maxCoeff();
    side_m_ = std::max(
        {std::sqrt(sum / (2 * count)), std::sqrt(all.sizes().prod() / (16 * count)), longest / (16 * count), 1e-9});
    origin_ = all.min();
    columns_ = static_cast<size_t>(all.sizes().x() / side_m_) + 1;
    marks_.resize(columns_ * (static_cast<size_t>(all.sizes().y() / side_m_) + 1), 0);
  }
  void Add(const Eigen::AlignedBox3d& box) {
    ForRows(box, [](uint8_t* begin, uint8_t* end) { return std::fill(begin, end, 1), false; });
  }
  bool Meets(const Eigen::AlignedBox3d& box) {
    return ForRows(box, [](uint8_t* begin, uint8_t* end) { return std::find(begin, end, 1) != end; });
  }

 private:
  // Squares of one of the boxes.
  template <class Body>
  bool ForRows(const Eigen::AlignedBox3d& box, const Body& body) {
    const auto at = [&](const Eigen::Vector3d& p, int k) { return static_cast<size_t>((p[k] - origin_[k]) / side_m_); };
    const size_t x0 = at(box.min(), 0), x1 = at(box.max(), 0) + 1, y1 = at(box.max(), 1);
    for (size_t y = at(box.min(), 1); y <= y1; ++y) {
      uint8_t* row = marks_.data() + y * columns_;
      if (body(row + x0, row + x1)) return true;
    }
    return false;
  }
  double side_m_ = 1;
  Eigen::Vector2d origin_ = Eigen::Vector2d::Zero();
  size_t columns_ = 0;
  std::vector<uint8_t> marks_;
};

// Adds the faces that may touch a flagged one. `squares`: of the flagged faces at the call before, `added`: flags of
// these.
void GrowContacts(const std::vector<Eigen::AlignedBox3d>& boxes, Squares* squares, std::vector<uint8_t>* added,
                  std::vector<uint8_t>* faces) {
  for (size_t f = 0; f < faces->size(); ++f) {
    if ((*faces)[f] && !(*added)[f]) squares->Add(boxes[f]);
  }
  *added = *faces;
  for (size_t f = 0; f < faces->size(); ++f) {
    if (!(*faces)[f] && squares->Meets(boxes[f])) (*faces)[f] = 1;
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

RepairDependencyRadius RepairDependencyRadiusOf(const StepperOptions& options) {
  RepairDependencyRadius radius;
  for (const SurfaceRepair::Pass& pass : SurfaceRepair::kPasses) {
    radius.rings.insert(radius.rings.begin(), SurfaceRepair::RingsOf(pass));
  }
  radius.start_rings = options.start_smoothing_steps + 1;
  return radius;
}

PickedMesh PickFlagged(const TriangleMesh& mesh, const std::vector<uint8_t>& faces) {
  constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();
  PickedMesh out;
  std::vector<uint32_t> place(mesh.vertices.size(), kNone);
  for (uint32_t f = 0; f < faces.size(); ++f) {
    if (!faces[f]) continue;
    out.faces.push_back(f);
    for (const uint32_t v : mesh.faces[f]) place[v] = 0;
  }
  for (uint32_t v = 0; v < place.size(); ++v) {
    if (place[v] == kNone) continue;
    place[v] = static_cast<uint32_t>(out.vertices.size());
    out.vertices.push_back(v);
    out.mesh.vertices.push_back(mesh.vertices[v]);
  }
  for (const uint32_t f : out.faces) {
    const auto& [a, b, c] = mesh.faces[f];
    out.mesh.faces.push_back({place[a], place[b], place[c]});
    if (!mesh.labels.empty()) out.mesh.labels.push_back(mesh.labels[f]);
  }
  return out;
}

void GrowRings(const TriangleMesh& mesh, const CsrRows& faces_of_vertex, int rings, std::vector<uint8_t>* faces) {
  std::vector<uint8_t> touched(mesh.vertices.size(), 0);
  std::vector<uint32_t> front, next;
  for (uint32_t f = 0; f < faces->size(); ++f) {
    if ((*faces)[f]) front.push_back(f);
  }
  for (int ring = 0; ring < rings; ++ring) {
    next.clear();
    for (const uint32_t f : front) {
      for (const uint32_t v : mesh.faces[f]) {
        if (touched[v]) continue;
        touched[v] = 1;
        for (const uint32_t g : faces_of_vertex[v]) {
          if ((*faces)[g]) continue;
          (*faces)[g] = 1;
          next.push_back(g);
        }
      }
    }
    std::swap(front, next);
  }
}

std::vector<uint8_t> FacesForRepair(const TriangleMesh& mesh, const CsrRows& faces_of_vertex,
                                    const std::vector<uint8_t>& core, const RepairDependencyRadius& radius,
                                    const std::vector<Eigen::AlignedBox3d>& boxes) {
  std::vector<uint8_t> faces = core;
  GrowRings(mesh, faces_of_vertex, 1, &faces);
  Squares squares(boxes);
  std::vector<uint8_t> added(faces.size(), 0);
  for (const int rings : radius.rings) {
    GrowRings(mesh, faces_of_vertex, rings, &faces);
    GrowContacts(boxes, &squares, &added, &faces);
  }
  GrowRings(mesh, faces_of_vertex, radius.start_rings, &faces);
  return faces;
}

std::vector<uint8_t> FindRegions(const TriangleMesh& mesh, const CsrRows& faces_of_vertex,
                                 const std::vector<Cell>& cell, const std::vector<uint8_t>& core,
                                 const RegionDependencyRadius& radius) {
  // Converts vertex rings to face rings: a vertex at distance d has all its faces within d + 1 rings.
  std::vector<uint8_t> solve = core;
  GrowRings(mesh, faces_of_vertex, radius.solve_rings + 1, &solve);
  std::vector<Eigen::AlignedBox3d> boxes(mesh.faces.size());
  const Eigen::Vector3d margin = Eigen::Vector3d::Constant(radius.contact_m / 2);
  for (size_t f = 0; f < boxes.size(); ++f) {
    for (const uint32_t v : mesh.faces[f]) boxes[f].extend(mesh.vertices[v]);
    boxes[f] = {boxes[f].min() - margin, boxes[f].max() + margin};
  }
  const std::vector<uint8_t> repair = FacesForRepair(mesh, faces_of_vertex, core, radius.repair, boxes);
  const std::vector<uint8_t> label = FacesInDependencyRadius(FaceLinks(mesh.faces), cell, core, radius.label);
  std::vector<uint8_t> regions(core.size());
  for (size_t f = 0; f < regions.size(); ++f) {
    regions[f] = static_cast<uint8_t>((core[f] ? kCoreRegion : 0) | (solve[f] ? kSolveRegion : 0) |
                                      (repair[f] ? kRepairRegion : 0) | (label[f] ? kLabelRegion : 0));
  }
  return regions;
}

}  // namespace tessera
