#include "tests/support/mesh_field.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "common/base/random.h"
#include "common/geometry/edge_list.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

// Which patch each point of the square of `size` lies in: Voronoi cells of random points, found through a grid of them.
class Patches {
 public:
  Patches(double size, double area, Random* random) : cell_(std::sqrt(area)), side_(std::ceil(size / cell_)) {
    for (int i = 0; i < side_ * side_; ++i) {
      const double x = i % side_ + random->Uniform(), y = std::floor(i / side_) + random->Uniform();
      points_.push_back(cell_ * Vector3d(x, y, 0));
    }
  }
  int count() const { return static_cast<int>(points_.size()); }
  int At(const Vector3d& p) const {
    const int column = static_cast<int>(p.x() / cell_), row = static_cast<int>(p.y() / cell_);
    int nearest = 0;
    double least = std::numeric_limits<double>::infinity();
    for (int y = std::max(0, row - 2); y <= std::min(side_ - 1, row + 2); ++y) {
      for (int x = std::max(0, column - 2); x <= std::min(side_ - 1, column + 2); ++x) {
        const double distance = (points_[y * side_ + x] - p).squaredNorm();
        if (distance < least) {
          least = distance;
          nearest = y * side_ + x;
        }
      }
    }
    return nearest;
  }

 private:
  double cell_;
  int side_;
  std::vector<Vector3d> points_;
};

TriangleMesh JitteredGrid(int n, Random* random) {
  TriangleMesh mesh;
  for (int y = 0; y <= n; ++y) {
    for (int x = 0; x <= n; ++x)
      mesh.vertices.push_back(Vector3d(x + 0.7 * random->Uniform(), y + 0.7 * random->Uniform(), 0));
  }
  const auto at = [n](int x, int y) { return static_cast<uint32_t>(y * (n + 1) + x); };
  for (int y = 0; y < n; ++y) {
    for (int x = 0; x < n; ++x) {
      const uint32_t a = at(x, y), b = at(x + 1, y), c = at(x + 1, y + 1), d = at(x, y + 1);
      if (random->Uniform() < 0.5) {
        mesh.faces.push_back({a, b, c});
        mesh.faces.push_back({a, c, d});
      } else {
        mesh.faces.push_back({a, b, d});
        mesh.faces.push_back({b, c, d});
      }
    }
  }
  return mesh;
}

}  // namespace

LabelField MakeMeshField(const MeshFieldOptions& options) {
  Random random(options.seed);
  const int n = std::max(1, static_cast<int>(std::lround(std::sqrt(0.5 * options.faces))));
  TriangleMesh mesh = JitteredGrid(n, &random);
  if (options.shuffled) {
    for (size_t i = mesh.faces.size() - 1; i > 0; --i) std::swap(mesh.faces[i], mesh.faces[random.Below(i + 1)]);
  }
  // Patches of truth, and smaller ones in which the classifier errs or sees nothing; areas in squares of two faces.
  const Patches truth(n + 1, 0.5 * options.patch_faces, &random), fault(n + 1, 0.05 * options.patch_faces, &random);
  std::vector<int> truth_class(truth.count()), fault_class(fault.count());
  for (int& c : truth_class) c = static_cast<int>(random.Below(options.classes));
  constexpr int kNone = -1, kUnseen = -2;
  for (int& c : fault_class) {
    const double kind = random.Uniform();
    c = kind < options.unseen_area                        ? kUnseen
        : kind < options.unseen_area + options.wrong_area ? static_cast<int>(random.Below(options.classes))
                                                          : kNone;
  }

  LabelField field;
  field.classes = options.classes;
  const double cell = options.cell_gsd / std::sqrt(24.0);  // in squares of two faces
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const Vector3d centre = (mesh.Corner(f, 0) + mesh.Corner(f, 1) + mesh.Corner(f, 2)) / 3;
    const double area = 2 * FaceArea(mesh, f);  // 1 on average
    field.cell.push_back({static_cast<int32_t>(centre.x() / cell), static_cast<int32_t>(centre.y() / cell)});
    const int fault_here = fault_class[fault.At(centre)];
    const int leads = fault_here >= 0 ? fault_here : truth_class[truth.At(centre)];
    for (int l = 0; l < options.classes; ++l) {
      const double cost = (l == leads ? 0 : options.contrast) + options.face_noise * random.Normal();
      field.unary.push_back(fault_here == kUnseen ? 0 : static_cast<float>(area * cost));
    }
  }
  for (const MeshEdge& e : EdgeList(mesh.faces)) {
    if (e.left < 0 || e.right < 0) continue;
    const double length = (mesh.vertices[e.a] - mesh.vertices[e.b]).norm() / 1.14;  // 1 on average
    field.edges.push_back(
        {static_cast<uint32_t>(e.left), static_cast<uint32_t>(e.right), static_cast<float>(options.coupling * length)});
  }
  return field;
}

}  // namespace tessera
