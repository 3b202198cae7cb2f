// Compares SmoothTerm::Reweight with its definition in dense matrices.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <array>
#include <map>

#include "tests/unit/worker/refine/labelled_meshes.h"
#include "worker/refine/smooth_term.h"

namespace tessera {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;

struct Dense {
  MatrixXd umbrella;          // rows of U; zero on boundaries
  std::vector<double> share;  // factor of the weights
};

Dense Definition(const TriangleMesh& mesh, const Positions& v, const CreaseWeights& creases) {
  const size_t n = v.size();
  std::map<std::array<uint32_t, 2>, int> edges;
  for (const auto& [a, b, c] : mesh.faces) {
    for (const auto& [p, q] : {std::pair(a, b), std::pair(b, c), std::pair(c, a)}) {
      ++edges[{std::min(p, q), std::max(p, q)}];
    }
  }
  std::vector<double> degree(n, 0);
  std::vector<bool> inside(n, true);
  MatrixXd adjacent = MatrixXd::Zero(n, n);
  for (const auto& [edge, count] : edges) {
    adjacent(edge[0], edge[1]) = adjacent(edge[1], edge[0]) = 1;
    for (const uint32_t k : edge) {
      degree[k] += 1;
      if (count != 2) inside[k] = false;
    }
  }
  Dense out{MatrixXd::Zero(n, n), std::vector<double>(n, 0)};
  MatrixXd at(n, 3);
  for (size_t k = 0; k < n; ++k) {
    at.row(k) = v[k].transpose();
    if (!inside[k] || degree[k] == 0) continue;
    out.umbrella.row(k) = -adjacent.row(k) / degree[k];
    out.umbrella(k, k) = 1;
  }
  const auto bends = [&](const MatrixXd& surface) {
    const MatrixXd rows = out.umbrella * surface;
    std::vector<double> found(n, 0);
    for (size_t k = 0; k < n; ++k) {
      if (out.umbrella.row(k).isZero(0)) continue;
      Vector3d normal = Vector3d::Zero();
      for (const auto& [a, b, c] : mesh.faces) {
        if (a == k || b == k || c == k) {
          normal += Vector3d(surface.row(b) - surface.row(a)).cross(Vector3d(surface.row(c) - surface.row(a)));
        }
      }
      double length = 0;
      for (size_t w = 0; w < n; ++w) length += adjacent(k, w) * (surface.row(w) - surface.row(k)).norm() / degree[k];
      found[k] = normal.normalized().dot(Vector3d(rows.row(k))) / length / creases.bend;
    }
    return found;
  };
  const std::vector<double> before = bends(at);
  for (int step = 0; step < SmoothTerm::kCreaseSteps; ++step) at -= 0.5 * out.umbrella * at;
  const std::vector<double> after = bends(at);
  for (size_t k = 0; k < n; ++k) {
    if (out.umbrella.row(k).isZero(0)) continue;
    const double s = after[k] * after[k], r = std::pow(0.19 / 0.41 * before[k], 2);
    out.share[k] = creases.flat / (1 + s / (1 + (r > s ? creases.rough * (r - s) : 0)));
  }
  return out;
}

TEST(CreaseWeights, MatchTheDefinition) {
  const SmoothWeights weights{0.7, 0, 0, 0};
  double least = 1, most = 0;
  for (uint64_t seed = 0; seed < 24; ++seed) {
    const CreaseWeights creases = {0.15, 1.4, seed % 2 == 0 ? 0 : 0.5};
    const TriangleMesh mesh = RandomLabelledMesh(seed);
    Random random(seed);
    Positions v = mesh.vertices;
    for (Vector3d& p : v) p += 0.2 * RandomVector(random);
    const size_t n = v.size();
    SmoothTerm term(mesh, {});
    term.SetLabels(std::vector<int32_t>(mesh.faces.size(), 0), {}, 0);
    term.Reweight(mesh.vertices, {0.5, 3});  // must leave no state behind
    term.Reweight(v, creases);

    const Dense dense = Definition(mesh, v, creases);
    Eigen::VectorXd share(n);
    MatrixXd at(n, 3);
    for (size_t k = 0; k < n; ++k) {
      at.row(k) = v[k].transpose();
      share[k] = dense.share[k];
      if (dense.umbrella.row(k).isZero(0)) continue;
      least = std::min(least, share[k]);
      most = std::max(most, share[k]);
    }
    const MatrixXd system = weights.thin_plate * dense.umbrella.transpose() * share.asDiagonal() * dense.umbrella;
    EXPECT_NEAR(term.Energy(v, weights), 0.5 * (at.transpose() * system * at).trace(), 1e-9) << seed;
    const MatrixXd slope = system * at;
    Positions gradient;
    term.Gradient(v, weights, &gradient);
    for (size_t k = 0; k < n; ++k) EXPECT_LT((gradient[k] - Vector3d(slope.row(k))).norm(), 1e-9) << seed;

    // The solver uses the same weights.
    std::vector<Matrix3d> data(n, 0.3 * Matrix3d::Identity());
    Positions rhs, step;
    MatrixXd right(n, 3), found(n, 3);
    for (size_t k = 0; k < n; ++k) {
      rhs.push_back(RandomVector(random));
      right.row(k) = rhs[k].transpose();
    }
    term.SolveStep(data, rhs, weights, 300, &step);
    for (size_t k = 0; k < n; ++k) found.row(k) = step[k].transpose();
    const MatrixXd exact = (system + 0.3 * MatrixXd::Identity(n, n)).ldlt().solve(right);
    EXPECT_LT((found - exact).norm(), 1e-5 * exact.norm()) << seed;
  }
  EXPECT_LT(least, 0.3);
  EXPECT_GT(most, 1.3);
}

// A noisy gable: with crease weights the ridge keeps more of its height and the slopes get no rougher.
TEST(CreaseWeights, PreserveARidgeAndFlattenItsSlopes) {
  const auto gable = [](double x, double) { return 4 - std::abs(x); };
  const TriangleMesh truth = HeightField(16, 4, gable);
  Random random(3);
  TriangleMesh noisy = truth;
  for (Vector3d& p : noisy.vertices) p.z() += 0.05 * random.Normal();
  const auto smoothed = [&](const CreaseWeights& creases) {
    SmoothTerm term(noisy, {});
    term.SetLabels(std::vector<int32_t>(noisy.faces.size(), 0), {}, 0);
    TriangleMesh out = noisy;
    for (int i = 0; i < 10; ++i) {
      Positions gradient, step;
      term.Reweight(out.vertices, creases);
      term.Gradient(out.vertices, {1, 0, 0, 0}, &gradient);
      for (size_t k = 0; k < gradient.size(); ++k)
        gradient[k] = -gradient[k] - 0.1 * (out.vertices[k] - noisy.vertices[k]);
      term.SolveStep(std::vector<Matrix3d>(gradient.size(), 0.1 * Matrix3d::Identity()), gradient, {1, 0, 0, 0}, 100,
                     &step);
      for (size_t k = 0; k < step.size(); ++k) out.vertices[k] += step[k];
    }
    double ridge = 0, slopes = 0;
    int on_ridge = 0, on_slopes = 0;
    for (size_t k = 0; k < truth.vertices.size(); ++k) {
      const Vector3d& p = truth.vertices[k];
      const double error = out.vertices[k].z() - gable(out.vertices[k].x(), 0);
      if (std::abs(p.y()) > 2 || std::abs(p.x()) > 3) continue;
      if (p.x() == 0) {
        ridge -= error;
        ++on_ridge;
      } else if (std::abs(p.x()) > 1.4) {
        slopes += error * error;
        ++on_slopes;
      }
    }
    return std::pair(ridge / on_ridge, std::sqrt(slopes / on_slopes));
  };
  const auto [plain_ridge, plain_slopes] = smoothed({});
  for (const double rough : {0.0, 4.0}) {
    const auto [ridge, slopes] = smoothed({0.12, 1.3, rough});
    EXPECT_GT(plain_ridge, 0.05);
    EXPECT_LT(ridge, 0.7 * plain_ridge) << rough;
    EXPECT_LT(slopes, 1.02 * plain_slopes) << rough;
  }
}

// Bends by noise are smoothed like a plane, bends by a crease are not.
TEST(CreaseWeights, NoiseIsNotTreatedAsACrease) {
  Random random(5);
  TriangleMesh rough = HeightField(16, 16, [](double, double) { return 0.0; });
  for (Vector3d& p : rough.vertices) p.z() += 0.8 * random.Normal();
  const TriangleMesh gable = HeightField(16, 4, [](double x, double) { return 4 - std::abs(x); });
  const auto energies = [](const TriangleMesh& mesh, double rough) {
    SmoothTerm term(mesh, {});
    term.SetLabels(std::vector<int32_t>(mesh.faces.size(), 0), {}, 0);
    const double plain = term.Energy(mesh.vertices, {1, 0, 0, 0});
    term.Reweight(mesh.vertices, {0.12, 1, rough});
    return term.Energy(mesh.vertices, {1, 0, 0, 0}) / plain;
  };
  EXPECT_LT(energies(rough, 0), 0.85);
  EXPECT_GT(energies(rough, 4), 0.97);
  EXPECT_LT(energies(gable, 0), 0.35);
  EXPECT_LT(energies(gable, 4), 0.35);
}

}  // namespace
}  // namespace tessera
