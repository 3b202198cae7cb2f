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

// A set of faces that grows. The work of all calls is in proportion to the set.
class GrowingFaces {
 public:
  GrowingFaces(const TriangleMesh& mesh, const CsrRows& faces_of_vertex, std::vector<uint8_t>* flags)
      : mesh_(mesh), faces_of_vertex_(faces_of_vertex), flags_(*flags), touched_(mesh.vertices.size()) {
    for (uint32_t f = 0; f < flags_.size(); ++f) {
      if (flags_[f]) faces_.push_back(f);
    }
  }

  void AddRings(int rings) {
    for (int ring = 0; ring < rings; ++ring) {
      for (const size_t end = faces_.size(); surrounded_ < end; ++surrounded_) {
        for (const uint32_t v : mesh_.faces[faces_[surrounded_]]) {
          if (touched_[v]) continue;
          touched_[v] = 1;
          for (const uint32_t g : faces_of_vertex_[v]) Add(g);
        }
      }
    }
  }

  // Adds the faces that may touch one of the set. `boxes`: the same in all calls, those of `squares`.
  void AddContacts(const std::vector<Eigen::AlignedBox3d>& boxes, Squares* squares) {
    for (; marked_ < faces_.size(); ++marked_) squares->Add(boxes[faces_[marked_]]);
    for (uint32_t f = 0; f < flags_.size(); ++f) {
      if (!flags_[f] && squares->Meets(boxes[f])) Add(f);
    }
  }

 private:
  void Add(uint32_t face) {
    if (flags_[face]) return;
    flags_[face] = 1;
    faces_.push_back(face);
  }

  const TriangleMesh& mesh_;
  const CsrRows& faces_of_vertex_;
  std::vector<uint8_t>& flags_;
  std::vector<uint8_t> touched_;  // vertices all of whose faces are in the set
  std::vector<uint32_t> faces_;   // the set, in the order of adding
  size_t surrounded_ = 0;         // faces before this one have all neighbours in the set
  size_t marked_ = 0;             // faces before this one are in the squares of AddContacts
};

// Pairs of faces that share an edge.
std::vector<std::array<uint32_t, 2>> FaceLinks(const std::vector<Triangle>& faces, const CsrRows& faces_of_vertex) {
  std::vector<std::array<uint32_t, 2>> links;
  links.reserve(faces.size() * 3 / 2);
  for (uint32_t f = 0; f < faces.size(); ++f) {
    for (size_t k = 0; k < 3; ++k) {
      const uint32_t from = faces[f][k], to = faces[f][(k + 1) % 3];
      for (const uint32_t g : faces_of_vertex[from]) {
        if (g > f && (faces[g][0] == to || faces[g][1] == to || faces[g][2] == to)) links.push_back({f, g});
      }
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
  GrowingFaces(mesh, faces_of_vertex, faces).AddRings(rings);
}

std::vector<uint8_t> FacesForRepair(const TriangleMesh& mesh, const CsrRows& faces_of_vertex,
                                    const std::vector<uint8_t>& core, const RepairDependencyRadius& radius,
                                    const std::vector<Eigen::AlignedBox3d>& boxes) {
  std::vector<uint8_t> flags = core;
  GrowingFaces faces(mesh, faces_of_vertex, &flags);
  faces.AddRings(1);
  Squares squares(boxes);
  for (const int rings : radius.rings) {
    faces.AddRings(rings);
    faces.AddContacts(boxes, &squares);
  }
  faces.AddRings(radius.start_rings);
  return flags;
}

std::vector<uint8_t> FindRegions(const TriangleMesh& mesh, const std::vector<Eigen::Vector3d>& positions,
                                 const CsrRows& faces_of_vertex, const std::vector<Cell>& cell,
                                 const std::vector<uint8_t>& core, const RegionDependencyRadius& radius) {
  // Converts vertex rings to face rings: a vertex at distance d has all its faces within d + 1 rings.
  std::vector<uint8_t> solve = core;
  GrowRings(mesh, faces_of_vertex, radius.solve_rings + 1, &solve);
  std::vector<Eigen::AlignedBox3d> boxes(mesh.faces.size());
  const Eigen::Vector3d margin = Eigen::Vector3d::Constant(radius.contact_m / 2);
  for (size_t f = 0; f < boxes.size(); ++f) {
    for (const uint32_t v : mesh.faces[f]) boxes[f].extend(positions[v]);
    boxes[f] = {boxes[f].min() - margin, boxes[f].max() + margin};
  }
  const std::vector<uint8_t> repair = FacesForRepair(mesh, faces_of_vertex, core, radius.repair, boxes);
  const std::vector<uint8_t> label =
      FacesInDependencyRadius(FaceLinks(mesh.faces, faces_of_vertex), cell, core, radius.label);
  std::vector<uint8_t> regions(core.size());
  for (size_t f = 0; f < regions.size(); ++f) {
    regions[f] = static_cast<uint8_t>((core[f] ? kCoreRegion : 0) | (solve[f] ? kSolveRegion : 0) |
                                      (repair[f] ? kRepairRegion : 0) | (label[f] ? kLabelRegion : 0));
  }
  return regions;
}

}  // namespace tessera
