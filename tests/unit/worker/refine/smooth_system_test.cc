// Compares E_intra with labels, and SolveStep, with dense matrices built from the definitions.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <array>
#include <map>
#include <set>

#include "common/base/parallel.h"
#include "tests/unit/worker/refine/labelled_meshes.h"
#include "worker/refine/inter_term.h"
#include "worker/refine/smooth_term.h"

namespace tessera {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr uint64_t kSystemSeeds = 12;
const std::vector<ClassSmoothness> kClasses = {{2, 0.7}, {0.5, 0}, {1, 0}, {0.3, 0.2}};
constexpr double kMixed = 0.15;

Positions Moved(const TriangleMesh& mesh, uint64_t seed) {
  Random random(seed + 5);
  Positions v = mesh.vertices;
  for (Vector3d& p : v) p += 0.2 * RandomVector(random);
  return v;
}

SmoothTerm LabelledTerm(const TriangleMesh& mesh, const std::vector<uint8_t>& fixed) {
  SmoothTerm term(mesh, fixed);
  term.SetLabels(mesh.labels, kClasses, kMixed);
  return term;
}

// A of SmoothTerm by its definition, all vertices free; fixed ones only lose their boundary rows.
MatrixXd Definition(const TriangleMesh& mesh, const std::vector<uint8_t>& fixed, const SmoothWeights& weights) {
  const size_t n = mesh.vertices.size();
  std::map<std::array<uint32_t, 2>, int> edges;
  std::vector<std::set<int32_t>> labels(n);
  std::vector<double> faces_at(n, 0);
  std::vector<Matrix3d> anchor(n, Matrix3d::Zero());
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const auto [a, b, c] = mesh.faces[f];
    const Vector3d n_start = FaceNormal(mesh, f);
    for (uint32_t v : {a, b, c}) {
      labels[v].insert(mesh.labels[f]);
      faces_at[v] += 1;
      if (mesh.labels[f] >= 0) anchor[v] += kClasses[mesh.labels[f]].anchor * n_start * n_start.transpose();
    }
    for (const auto& [p, q] : {std::pair(a, b), std::pair(b, c), std::pair(c, a)}) {
      ++edges[{std::min(p, q), std::max(p, q)}];
    }
  }
  const auto omega = [&](uint32_t v) {
    if (labels[v].size() != 1) return kMixed;
    return *labels[v].begin() < 0 ? 1.0 : kClasses[*labels[v].begin()].smoothness;
  };
  std::vector<std::set<uint32_t>> ring(n), along_boundary(n);
  std::vector<bool> boundary(n);
  for (const auto& [edge, count] : edges) {
    for (int k : {0, 1}) {
      ring[edge[k]].insert(edge[1 - k]);
      if (count != 2) {
        boundary[edge[k]] = true;
        along_boundary[edge[k]].insert(edge[1 - k]);
      }
    }
  }
  MatrixXd out = MatrixXd::Zero(3 * n, 3 * n);
  const auto add_row = [&](uint32_t v, const std::set<uint32_t>& others, double weight) {
    MatrixXd row = MatrixXd::Zero(3, 3 * n);
    row.block<3, 3>(0, 3 * v).setIdentity();
    for (uint32_t w : others) row.block<3, 3>(0, 3 * w) -= Matrix3d::Identity() / static_cast<double>(others.size());
    out += row.transpose() * weight * row;
  };
  for (uint32_t v = 0; v < n; ++v) {
    if (!boundary[v] && !ring[v].empty()) add_row(v, ring[v], weights.thin_plate * omega(v));
    if (along_boundary[v].size() == 2 && !(fixed.size() && fixed[v])) add_row(v, along_boundary[v], weights.boundary);
    out.block<3, 3>(3 * v, 3 * v) += weights.anchor / std::max(faces_at[v], 1.0) * anchor[v];
  }
  for (const auto& [edge, count] : edges) {
    if (count != 2 || (boundary[edge[0]] && boundary[edge[1]])) continue;
    double weight = weights.membrane / 6;
    weight *= labels[edge[0]].size() == 1 ? omega(edge[0]) : omega(edge[1]);
    for (int k : {0, 1}) {
      out.block<3, 3>(3 * edge[k], 3 * edge[k]) += weight * Matrix3d::Identity();
      out.block<3, 3>(3 * edge[k], 3 * edge[1 - k]) -= weight * Matrix3d::Identity();
    }
  }
  return out;
}

// The columns of A from SmoothTerm itself, by differences of its gradient.
MatrixXd FromGradients(const SmoothTerm& term, const Positions& start, const SmoothWeights& weights) {
  MatrixXd out(3 * start.size(), 3 * start.size());
  Positions v = start, at_start, gradient;
  term.Gradient(start, weights, &at_start);
  for (size_t k = 0; k < start.size(); ++k) {
    for (int axis = 0; axis < 3; ++axis) {
      v[k][axis] += 1;
      term.Gradient(v, weights, &gradient);
      for (size_t w = 0; w < start.size(); ++w) out.block<3, 1>(3 * w, 3 * k + axis) = gradient[w] - at_start[w];
      v[k] = start[k];
    }
  }
  return out;
}

TEST(SmoothSystem, GradientIsTheDerivativeOfTheEnergy) {
  for (uint64_t seed = 0; seed < kSystemSeeds; ++seed) {
    const TriangleMesh mesh = RandomLabelledMesh(seed);
    const std::vector<uint8_t> fixed = SomeFixed(mesh, seed);
    SmoothTerm term = LabelledTerm(mesh, fixed);
    const Positions v = Moved(mesh, seed);
    const SmoothWeights weights{0.7, 0.2, 0.4, 0.6};
    Positions gradient;
    term.Gradient(v, weights, &gradient);
    const auto energy = [&](const Positions& at) { return term.Energy(at, weights); };
    EXPECT_LT(DerivativeError(energy, gradient, v, fixed, 1e-3), 1e-8) << seed;
    for (size_t k = 0; k < fixed.size(); ++k) {
      if (fixed[k]) {
        EXPECT_EQ(gradient[k], Vector3d::Zero());
      }
    }
    // The same check fails for another class's weight, and for the umbrella without its transpose.
    std::vector<ClassSmoothness> other = kClasses;
    for (ClassSmoothness& c : other) c.smoothness *= 1.01;
    Positions wrong;
    term.SetLabels(mesh.labels, other, kMixed);
    term.Gradient(v, weights, &wrong);
    term.SetLabels(mesh.labels, kClasses, kMixed);
    EXPECT_GT(DerivativeError(energy, wrong, v, fixed, 1e-3), 1e-4) << seed;
    std::vector<Vector3d> sum(v.size(), Vector3d::Zero());
    std::vector<double> count(v.size(), 0);
    for (const Triangle& face : mesh.faces) {
      for (int k = 0; k < 3; ++k) {
        sum[face[k]] += v[face[(k + 1) % 3]];
        count[face[k]] += 1;
      }
    }
    for (size_t k = 0; k < v.size(); ++k) wrong[k] = weights.thin_plate * (v[k] - sum[k] / count[k]);
    EXPECT_GT(DerivativeError(energy, wrong, v, fixed, 1e-3), 1e-2) << seed;
  }
}

TEST(SmoothSystem, OperatorMatchesTheDefinitionAndIsPositiveSemidefinite) {
  for (uint64_t seed = 0; seed < kSystemSeeds; ++seed) {
    TriangleMesh mesh = RandomLabelledMesh(seed);
    mesh.labels[11] = mesh.labels[12] = -1;
    SmoothTerm term = LabelledTerm(mesh, {});
    const Positions v = Moved(mesh, seed);
    const SmoothWeights weights{0.7, 0.2, 0.4, 0.6};
    const MatrixXd a = FromGradients(term, v, weights);
    EXPECT_LT((a - Definition(mesh, {}, weights)).cwiseAbs().maxCoeff(), 1e-12) << seed;
    EXPECT_LT((a - a.transpose()).cwiseAbs().maxCoeff(), 1e-12);
    const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(a, Eigen::EigenvaluesOnly);
    EXPECT_GT(eigen.eigenvalues().minCoeff(), -1e-12);
    EXPECT_GT(eigen.eigenvalues().maxCoeff(), 0.5);
  }
}

struct Problem {
  std::vector<Matrix3d> data;
  Positions rhs;
};

// Data that constrain one direction per vertex, as images do; `floor` in the other directions.
Problem RandomProblem(size_t vertices, uint64_t seed, double floor) {
  Random random(seed + 31);
  Problem problem;
  for (size_t v = 0; v < vertices; ++v) {
    const Vector3d normal = RandomVector(random).normalized();
    problem.data.push_back(random.Uniform(0, 4) * normal * normal.transpose() + floor * Matrix3d::Identity());
    problem.rhs.push_back(RandomVector(random));
  }
  return problem;
}

// Relative to the exact step.
double SolveError(const TriangleMesh& mesh, const std::vector<uint8_t>& fixed, const MatrixXd& a,
                  const Problem& problem, const Positions& step) {
  MatrixXd system = a;
  VectorXd rhs(3 * step.size()), approximate(3 * step.size());
  for (size_t v = 0; v < mesh.vertices.size(); ++v) {
    system.block<3, 3>(3 * v, 3 * v) += problem.data[v];
    rhs.segment<3>(3 * v) = problem.rhs[v];
    approximate.segment<3>(3 * v) = step[v];
  }
  for (size_t v = 0; v < fixed.size(); ++v) {
    if (!fixed[v]) continue;
    system.middleRows<3>(3 * v).setZero();
    system.middleCols<3>(3 * v).setZero();
    system.block<3, 3>(3 * v, 3 * v).setIdentity();
    rhs.segment<3>(3 * v).setZero();
  }
  const VectorXd exact = system.ldlt().solve(rhs);
  return (exact - approximate).norm() / exact.norm();
}

MatrixXd DenseSystem(const InterCurvature& curvature, size_t vertices) {
  MatrixXd out = MatrixXd::Zero(3 * vertices, 3 * vertices);
  for (const auto& corner : curvature.corners) {
    Eigen::Matrix<double, 3, 9> jacobian;
    const Matrix3d a = corner.inverse_a * (Matrix3d::Identity() - (corner.a * corner.a.transpose()).cast<double>());
    const Matrix3d b = corner.inverse_b * (Matrix3d::Identity() - (corner.b * corner.b.transpose()).cast<double>());
    jacobian << -a - b, a, b;
    const Eigen::Matrix<double, 9, 9> block = corner.weight * jacobian.transpose() * jacobian;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        out.block<3, 3>(3 * corner.vertex[i], 3 * corner.vertex[j]) += block.block<3, 3>(3 * i, 3 * j);
      }
    }
  }
  return out;
}

TEST(SmoothSystem, SolveStepConvergesToTheDenseSolution) {
  for (uint64_t seed = 0; seed < kSystemSeeds; ++seed) {
    const TriangleMesh mesh = RandomLabelledMesh(seed);
    const std::vector<uint8_t> fixed = SomeFixed(mesh, seed);
    SmoothTerm term = LabelledTerm(mesh, fixed);
    const Positions v = Moved(mesh, seed);
    const SmoothWeights weights{1, 0.1, 0.3, 0.6};
    InterTerm inter(mesh, fixed);
    inter.SetLabels(mesh.labels);
    const InterCurvature curvature = inter.Curvature(v, 0.2);
    const Problem problem = RandomProblem(mesh.vertices.size(), seed, 0.3);
    MatrixXd a = Definition(mesh, fixed, weights);
    Positions step;
    term.SolveStep(problem.data, problem.rhs, weights, 300, &step);
    EXPECT_LT(SolveError(mesh, fixed, a, problem, step), 1e-5) << seed;
    for (size_t k = 0; k < fixed.size(); ++k) {
      if (fixed[k]) {
        EXPECT_EQ(step[k], Vector3d::Zero());
      }
    }
    a += DenseSystem(curvature, mesh.vertices.size());
    EXPECT_GT(SolveError(mesh, fixed, a, problem, step), 1e-2) << "E_inter must matter here";
    term.SolveStep(problem.data, problem.rhs, weights, 300, &step, &curvature);
    EXPECT_LT(SolveError(mesh, fixed, a, problem, step), 1e-5) << seed;
  }
}

// Vertices of high degree next to vertices of low degree have the largest eigenvalues.
TEST(SmoothSystem, SweepsConvergeForHighDegreesAndAnyWeights) {
  TriangleMesh mesh = Torus(9, 9);
  const size_t faces = mesh.faces.size();
  for (size_t f = 0; f < faces; ++f) {  // a vertex of degree three in each face doubles the degree of the others
    const auto [a, b, c] = mesh.faces[f];
    const uint32_t d = static_cast<uint32_t>(mesh.vertices.size());
    mesh.vertices.push_back((mesh.vertices[a] + mesh.vertices[b] + mesh.vertices[c]) / 3);
    mesh.faces[f] = {a, b, d};
    mesh.faces.push_back({b, c, d});
    mesh.faces.push_back({c, a, d});
  }
  Random random(8);
  for (size_t f = 0; f < mesh.faces.size(); ++f) mesh.labels.push_back(static_cast<int32_t>(f % 50 / 20));
  const Positions v = Moved(mesh, 3);
  const Problem problem = RandomProblem(mesh.vertices.size(), 3, 1e-3);
  InterTerm inter(mesh, {});
  inter.SetLabels(mesh.labels);
  for (double plate : {1e-3, 1.0, 1e3}) {
    for (double border : {0.0, 1.0, 1e4}) {
      SmoothTerm term(mesh, {});
      term.SetLabels(mesh.labels, {{1, 0}, {100, 0}, {0.01, 0}}, 0.1);
      const InterCurvature curvature = inter.Curvature(v, border);
      const SmoothWeights weights{plate, 0.05 * plate, 0, 0};
      Positions few, many;
      term.SolveStep(problem.data, problem.rhs, weights, 40, &few, &curvature);
      term.SolveStep(problem.data, problem.rhs, weights, 400, &many, &curvature);
      double few_norm = 0, many_norm = 0;
      for (size_t k = 0; k < few.size(); ++k) {
        few_norm += few[k].squaredNorm();
        many_norm += many[k].squaredNorm();
      }
      EXPECT_TRUE(std::isfinite(many_norm));
      // Converges to the solution from below; the smallest data curvature bounds it.
      EXPECT_LT(std::sqrt(many_norm), 1e3 * std::sqrt(3.0 * static_cast<double>(few.size()))) << plate << " " << border;
      EXPECT_LT(std::sqrt(few_norm), 1.5 * std::sqrt(many_norm)) << plate << " " << border;
    }
  }
}

TEST(SmoothSystem, OneClassOfWeightOneEqualsNoLabels) {
  for (uint64_t seed = 0; seed < kSystemSeeds; ++seed) {
    const TriangleMesh mesh = RandomLabelledMesh(seed);
    const std::vector<uint8_t> fixed = SomeFixed(mesh, seed);
    const SmoothTerm plain(mesh, fixed);
    const Positions v = Moved(mesh, seed);
    const SmoothWeights weights{0.7, 0.2, 0.4, 0.6};
    const Problem problem = RandomProblem(v.size(), seed, 0);
    Positions gradient, step;
    plain.Gradient(v, weights, &gradient);
    plain.SolveStep(problem.data, problem.rhs, weights, 10, &step);
    const auto expect_same = [&](const SmoothTerm& term) {
      Positions other;
      EXPECT_EQ(term.Energy(v, weights), plain.Energy(v, weights));
      term.Gradient(v, weights, &other);
      EXPECT_EQ(gradient, other);
      term.SolveStep(problem.data, problem.rhs, weights, 10, &other);
      EXPECT_EQ(step, other);
    };
    SmoothTerm term(mesh, fixed);
    const std::vector<int32_t> ones(mesh.faces.size(), 1), none(mesh.faces.size(), -1);
    term.SetLabels(ones, {{5, 5}, {1, 0}}, 0.1);
    expect_same(term);
    term.SetLabels(mesh.labels, kClasses, kMixed);  // must leave no state behind
    term.SetLabels(none, kClasses, kMixed);
    expect_same(term);
    term.SetLabels(mesh.labels, kClasses, kMixed);
    term.Reweight(v, {0.2, 1.5, 1});
    term.SetLabels({}, kClasses, kMixed);
    expect_same(term);
    term.Reweight(v, {0.2, 1.5, 1});  // without labels there is nothing to reweight
    expect_same(term);
  }
}

TEST(SmoothSystem, UnusedClassChangesNothing) {
  const TriangleMesh mesh = RandomLabelledMesh(1);
  std::vector<ClassSmoothness> classes = kClasses;
  SmoothTerm term = LabelledTerm(mesh, {}), other = term;
  classes.push_back({17, 4});
  other.SetLabels(mesh.labels, classes, kMixed);
  const Positions v = Moved(mesh, 1);
  Positions gradient, same;
  term.Gradient(v, {0.7, 0.2, 0.4}, &gradient);
  other.Gradient(v, {0.7, 0.2, 0.4}, &same);
  EXPECT_EQ(gradient, same);
}

TEST(SmoothSystem, AnchorActsOnItsClassAlongTheNormals) {
  TriangleMesh mesh = HeightField(8, 4, [](double x, double) { return 0.5 * x; });
  for (const Triangle& f : mesh.faces) mesh.labels.push_back(mesh.vertices[f[0]].y() < 0 ? 0 : 1);
  SmoothTerm term(mesh, {});
  term.SetLabels(mesh.labels, {{1, 3}, {1, 0}}, 0);
  const SmoothWeights weights{0, 0, 0, 2};
  const Vector3d normal = FaceNormal(mesh, 0);
  Positions v = mesh.vertices, gradient;
  for (Vector3d& p : v) p += 0.1 * normal + Vector3d(0, 0.4, 0) + 0.3 * Vector3d(1, 0, 0.5);
  term.Gradient(v, weights, &gradient);
  for (size_t k = 0; k < v.size(); ++k) {
    const double y = mesh.vertices[k].y();
    if (y < -0.5) {
      EXPECT_LT((gradient[k] - 0.1 * 6 * normal).norm(), 1e-12);
    } else if (y > 0.5) {
      EXPECT_EQ(gradient[k], Vector3d::Zero());
    }
  }
}

TEST(SmoothSystem, IsEquivariantUnderRotation) {
  for (uint64_t seed = 0; seed < kSystemSeeds; ++seed) {
    TriangleMesh mesh = RandomLabelledMesh(seed);
    const SmoothWeights weights{0.7, 0.2, 0.4, 0.6};
    const Problem problem = RandomProblem(mesh.vertices.size(), seed, 0.1);
    Random random(seed);
    const Matrix3d rotation =
        Eigen::AngleAxisd(random.Uniform(0, 3), RandomVector(random).normalized()).toRotationMatrix();
    const Vector3d shift = 5 * RandomVector(random);
    Positions v = Moved(mesh, seed), gradient[2], step[2];
    Problem turned = problem;
    for (int round : {0, 1}) {
      SmoothTerm term = LabelledTerm(mesh, {});
      term.Gradient(v, weights, &gradient[round]);
      term.SolveStep(turned.data, turned.rhs, weights, 10, &step[round]);
      for (Vector3d& p : mesh.vertices) p = rotation * p + shift;
      for (Vector3d& p : v) p = rotation * p + shift;
      for (Matrix3d& m : turned.data) m = rotation * m * rotation.transpose();
      for (Vector3d& p : turned.rhs) p = rotation * p;
    }
    for (size_t k = 0; k < v.size(); ++k) {
      EXPECT_LT((gradient[1][k] - rotation * gradient[0][k]).norm(), 1e-12);
      EXPECT_LT((step[1][k] - rotation * step[0][k]).norm(), 1e-5 * (1 + step[0][k].norm()));
    }
  }
}

// Steps of active vertices have the same bytes as if all vertices were active, with fewer vertices per sweep.
TEST(SmoothSystem, ActiveStepsEqualThoseOfAllVertices) {
  for (uint64_t seed = 0; seed < kSystemSeeds; ++seed) {
    const TriangleMesh mesh = RandomLabelledMesh(seed);
    const std::vector<uint8_t> fixed = SomeFixed(mesh, seed);
    const Problem problem = RandomProblem(mesh.vertices.size(), seed, 0.3);
    const SmoothWeights weights{0.7, 0.2, 0.4, 0.6};
    InterTerm inter(mesh, fixed);
    inter.SetLabels(mesh.labels);
    const InterCurvature curvature = inter.Curvature(mesh.vertices, 0.2);
    Random random(seed);
    std::vector<uint8_t> active(mesh.vertices.size(), 0);
    const size_t count = 1 + random.Below(6);
    for (size_t i = 0; i < count; ++i) active[random.Below(active.size())] = 1;
    SmoothTerm all(mesh, fixed), some(mesh, fixed, active);
    all.SetLabels(mesh.labels, kClasses, kMixed);
    some.SetLabels(mesh.labels, kClasses, kMixed);
    for (const int sweeps : {0, 1, 2, 3, 7, 20}) {
      Positions expected, found;
      all.SolveStep(problem.data, problem.rhs, weights, sweeps, &expected, &curvature);
      some.SolveStep(problem.data, problem.rhs, weights, sweeps, &found, &curvature);
      for (size_t v = 0; v < active.size(); ++v) {
        ASSERT_EQ(found[v], active[v] ? expected[v] : Vector3d::Zero().eval()) << seed << " " << sweeps << " " << v;
      }
    }
  }
}

TEST(SmoothSystem, ResultIsIndependentOfThreads) {
  TriangleMesh mesh = HeightField(120, 40, [](double x, double y) { return std::sin(x) + std::cos(1.3 * y); });
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    mesh.labels.push_back(static_cast<int32_t>(f / 2 % 120 / 7 + f / 240 / 7) % 4);
  }
  std::vector<uint8_t> fixed(mesh.vertices.size());
  fixed[500] = 1;
  const Positions v = Moved(mesh, 1);
  const Problem problem = RandomProblem(v.size(), 2, 0);
  const SmoothWeights weights{0.7, 0.2, 0.4, 0.6};
  Positions gradient[2], step[2];
  double energy[2];
  for (int threads : {1, 2}) {
    const ThreadLimit limit(threads);
    SmoothTerm term = LabelledTerm(mesh, fixed);
    InterTerm inter(mesh, fixed);
    inter.SetLabels(mesh.labels);
    const InterCurvature curvature = inter.Curvature(v, 0.2);
    energy[threads - 1] = term.Energy(v, weights);
    term.Gradient(v, weights, &gradient[threads - 1]);
    term.SolveStep(problem.data, problem.rhs, weights, 10, &step[threads - 1], &curvature);
  }
  EXPECT_EQ(energy[0], energy[1]);
  EXPECT_EQ(gradient[0], gradient[1]);
  EXPECT_EQ(step[0], step[1]);
}

}  // namespace
}  // namespace tessera
