#include "worker/refine/inter_term.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <map>
#include <numeric>
#include <set>

#include "common/base/parallel.h"
#include "tests/unit/worker/refine/labelled_meshes.h"

namespace tessera {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using ::testing::ElementsAre;

constexpr uint64_t kSeeds = 12;

// A flat sheet with label 1 to the right of `border(y)`.
template <class Border>
TriangleMesh Sheet(const Border& border) {
  TriangleMesh mesh = HeightField(8, 4, [](double, double) { return 0.0; });
  for (const Triangle& f : mesh.faces) {
    const Vector3d centre = (mesh.vertices[f[0]] + mesh.vertices[f[1]] + mesh.vertices[f[2]]) / 3;
    mesh.labels.push_back(centre.x() > border(centre.y()) ? 1 : 0);
  }
  return mesh;
}

InterTerm TermOf(const TriangleMesh& mesh, const std::vector<uint8_t>& fixed = {}) {
  InterTerm term(mesh, fixed);
  term.SetLabels(mesh.labels);
  return term;
}

Positions Gradient(const InterTerm& term, const Positions& v, const std::vector<float>& pairs = {}) {
  Positions gradient(v.size(), Vector3d::Zero());
  term.AddGradient(v, 1, pairs, &gradient);
  return gradient;
}

// The definition: the faces at v are connected by edges at v, each such edge has two faces, there are two labels, and
// the faces of each label are connected.
std::vector<std::array<uint32_t, 3>> CornersByDefinition(const TriangleMesh& mesh) {
  std::vector<std::array<uint32_t, 3>> corners;
  for (uint32_t v = 0; v < mesh.vertices.size(); ++v) {
    std::map<uint32_t, std::vector<size_t>> edges;  // by their other end
    std::set<int32_t> labels;
    std::vector<size_t> faces;
    for (size_t f = 0; f < mesh.faces.size(); ++f) {
      if (std::count(mesh.faces[f].begin(), mesh.faces[f].end(), v) == 0) continue;
      faces.push_back(f);
      labels.insert(mesh.labels[f]);
      for (uint32_t w : mesh.faces[f]) {
        if (w != v) edges[w].push_back(f);
      }
    }
    const auto components = [&](bool within_labels) {
      std::map<size_t, size_t> root;
      for (size_t f : faces) root[f] = f;
      for (size_t round = 0; round < faces.size(); ++round) {
        for (const auto& [w, pair] : edges) {
          if (pair.size() != 2 || (within_labels && mesh.labels[pair[0]] != mesh.labels[pair[1]])) continue;
          root[pair[0]] = root[pair[1]] = std::min(root[pair[0]], root[pair[1]]);
        }
      }
      std::set<size_t> roots;
      for (const auto& [f, r] : root) roots.insert(r);
      return roots.size();
    };
    const bool inside =
        !faces.empty() && std::all_of(edges.begin(), edges.end(), [](const auto& e) { return e.second.size() == 2; });
    if (!inside || labels.size() != 2 || *labels.begin() < 0 || *labels.rbegin() == 255) continue;
    if (components(false) != 1 || components(true) != 2) continue;
    std::vector<uint32_t> ends;
    for (const auto& [w, pair] : edges) {
      if (mesh.labels[pair[0]] != mesh.labels[pair[1]]) ends.push_back(w);
    }
    corners.push_back({v, ends.at(0), ends.at(1)});
  }
  return corners;
}

TEST(InterTerm, CornersMatchTheDefinition) {
  size_t several_labels = 0, found = 0;
  for (uint64_t seed = 0; seed < kSeeds; ++seed) {
    TriangleMesh mesh = RandomLabelledMesh(seed);
    mesh.labels[3] = -1;
    mesh.labels[50] = 255;
    const InterTerm term = TermOf(mesh);
    EXPECT_EQ(term.corners(), CornersByDefinition(mesh)) << seed;
    found += term.corners().size();
    std::vector<std::set<int32_t>> labels(mesh.vertices.size());
    for (size_t f = 0; f < mesh.faces.size(); ++f) {
      for (uint32_t v : mesh.faces[f]) labels[v].insert(mesh.labels[f]);
    }
    several_labels += std::count_if(labels.begin(), labels.end(), [](const auto& l) { return l.size() > 1; });
  }
  EXPECT_GT(found, 100u);
  EXPECT_GT(several_labels, found + 50);  // points of three labels, scattered fans, rims
}

TEST(InterTerm, GradientIsTheDerivativeOfTheEnergy) {
  for (uint64_t seed = 0; seed < kSeeds; ++seed) {
    const TriangleMesh mesh = RandomLabelledMesh(seed);
    const std::vector<uint8_t> fixed = SomeFixed(mesh, seed);
    const InterTerm term = TermOf(mesh, fixed);
    ASSERT_FALSE(term.corners().empty());
    const Positions gradient = Gradient(term, mesh.vertices);
    const auto energy = [&](const Positions& v) { return term.Energy(v); };
    EXPECT_LT(DerivativeError(energy, gradient, mesh.vertices, fixed, 2e-6), 1e-6) << seed;
    for (size_t v = 0; v < fixed.size(); ++v) {
      if (fixed[v]) {
        EXPECT_EQ(gradient[v], Vector3d::Zero());
      }
    }
    // The same check fails for nearly correct formulas: k = 2 everywhere, and no derivative at the ends.
    Positions constant_k(gradient.size(), Vector3d::Zero()), no_ends = constant_k;
    for (const auto& [v, v1, v2] : term.corners()) {
      const Vector3d a = mesh.vertices[v1] - mesh.vertices[v], b = mesh.vertices[v2] - mesh.vertices[v];
      const double cosine = a.normalized().dot(b.normalized()), gamma = std::acos(cosine);
      const Vector3d at1 = 2 / a.norm() * (b.normalized() - cosine * a.normalized());
      const Vector3d at2 = 2 / b.norm() * (a.normalized() - cosine * b.normalized());
      constant_k[v1] += at1;
      constant_k[v2] += at2;
      constant_k[v] -= at1 + at2;
      no_ends[v] -= (M_PI - gamma) / std::sin(gamma) * (at1 + at2);
    }
    EXPECT_GT(DerivativeError(energy, constant_k, mesh.vertices, fixed, 2e-6), 1e-3) << seed;
    EXPECT_GT(DerivativeError(energy, no_ends, mesh.vertices, fixed, 2e-6), 1e-2) << seed;
  }
}

TEST(InterTerm, CornerWithoutImagePairsHasNoEnergy) {
  for (uint64_t seed = 0; seed < kSeeds; ++seed) {
    const TriangleMesh mesh = RandomLabelledMesh(seed);
    const InterTerm term = TermOf(mesh);
    const auto& v = mesh.vertices;
    std::vector<float> pairs(v.size());
    for (size_t i = 0; i < pairs.size(); ++i) pairs[i] = i % 3 == seed % 3 ? 0.0f : 0.5f;
    const auto energy = [&](const Positions& at) { return term.Energy(at, pairs); };
    EXPECT_LT(energy(v), 0.95 * term.Energy(v)) << seed;
    EXPECT_GT(energy(v), 0.1 * term.Energy(v)) << seed;
    EXPECT_LT(DerivativeError(energy, Gradient(term, v, pairs), v, {}, 2e-6), 1e-6) << seed;
    EXPECT_GT(DerivativeError(energy, Gradient(term, v), v, {}, 2e-6), 1e-3) << seed;
    const InterCurvature some = term.Curvature(v, 1, pairs), all = term.Curvature(v, 1);
    for (size_t c = 0; c < term.corners().size(); ++c) {
      const bool counts = pairs[term.corners()[c][0]] > 0;
      EXPECT_EQ(some.corners[c].weight, counts ? all.corners[c].weight : 0) << seed;
    }
    EXPECT_EQ(term.Energy(v, std::vector<float>(v.size(), 0.0f)), 0) << seed;
  }
}

TEST(InterTerm, StraightBorderHasNoGradient) {
  const TriangleMesh mesh = Sheet([](double) { return 0.0; });
  const InterTerm term = TermOf(mesh);
  EXPECT_EQ(term.corners().size(), 7u);
  EXPECT_EQ(term.Energy(mesh.vertices), 0);
  for (const Vector3d& g : Gradient(term, mesh.vertices)) EXPECT_EQ(g, Vector3d::Zero());
  // Nearly straight: the energy is quadratic without loss of digits.
  Positions bent = mesh.vertices;
  const auto [v, v1, v2] = term.corners()[3];
  bent[v].z() += 1e-7;  // edges of one metre: γ is 2e-7 below π, half of that at the neighbours
  EXPECT_NEAR(term.Energy(bent) / (6e-14), 1, 1e-6);
  EXPECT_NEAR(Gradient(term, bent)[v].z() / (12e-7), 1, 1e-6);
}

TEST(InterTerm, RightAngleHasTheEnergyOfTheFormula) {
  const TriangleMesh mesh = Sheet([](double y) { return y > 0 ? 0.0 : 9.0; });
  const InterTerm term = TermOf(mesh);
  EXPECT_EQ(term.corners(), CornersByDefinition(mesh));
  // One corner of 90 degrees or two of 45, depending on the diagonals.
  const double energy = term.Energy(mesh.vertices);
  EXPECT_NEAR(energy, energy > 2 ? M_PI * M_PI / 4 : M_PI * M_PI / 8, 1e-12);
}

TEST(InterTerm, GradientIsBoundedAtAngleZero) {
  TriangleMesh mesh = Sheet([](double) { return 0.0; });
  const InterTerm term = TermOf(mesh);
  const auto [v, v1, v2] = term.corners()[3];
  for (double aside : {1e-3, 1e-6, 1e-9, 1e-12, 1e-15, 0.0}) {
    Positions folded = mesh.vertices;
    folded[v2] = folded[v1] + Vector3d(0, 0, aside);
    const Positions gradient = Gradient(term, folded);
    // At most five corners contain one of these vertices, with 2π over a length of one at either end.
    for (const Vector3d& g : gradient) EXPECT_LE(g.norm(), 5 * 4 * M_PI);
    EXPECT_TRUE(std::isfinite(term.Energy(folded)));
    for (const auto& corner : term.Curvature(folded, 1).corners) EXPECT_LE(corner.weight, 16.0f);
  }
  Positions collapsed = mesh.vertices;
  collapsed[v1] = collapsed[v];
  for (const Vector3d& g : Gradient(term, collapsed)) EXPECT_TRUE(g.allFinite());
  EXPECT_TRUE(std::isfinite(term.Energy(collapsed)));
}

TEST(InterTerm, IsEquivariantUnderRotationAndScaling) {
  for (uint64_t seed = 0; seed < kSeeds; ++seed) {
    const TriangleMesh mesh = RandomLabelledMesh(seed);
    const InterTerm term = TermOf(mesh);
    Random random(seed);
    const Matrix3d rotation =
        Eigen::AngleAxisd(random.Uniform(0, 3), RandomVector(random).normalized()).toRotationMatrix();
    const Vector3d shift = 5 * RandomVector(random);
    constexpr double kScale = 3.7;
    Positions moved;
    for (const Vector3d& p : mesh.vertices) moved.push_back(kScale * (rotation * p) + shift);
    EXPECT_NEAR(term.Energy(moved), term.Energy(mesh.vertices), 1e-9);
    const Positions before = Gradient(term, mesh.vertices), after = Gradient(term, moved);
    Vector3d sum = Vector3d::Zero(), torque = Vector3d::Zero();
    for (size_t v = 0; v < before.size(); ++v) {
      EXPECT_LT((kScale * after[v] - rotation * before[v]).norm(), 1e-9);
      sum += before[v];
      torque += mesh.vertices[v].cross(before[v]);
      EXPECT_TRUE(before[v].allFinite());
    }
    EXPECT_LT(sum.norm(), 1e-9);
    EXPECT_LT(torque.norm(), 1e-9);
  }
}

// The curvature as a dense matrix, from Residual and Transposed.
MatrixXd Dense(const InterCurvature& curvature, size_t vertices) {
  MatrixXd out = MatrixXd::Zero(3 * vertices, 3 * vertices);
  for (const auto& corner : curvature.corners) {
    for (int from = 0; from < 3; ++from) {
      for (int axis = 0; axis < 3; ++axis) {
        std::array<Eigen::Vector3f, 3> x = {Eigen::Vector3f::Zero(), Eigen::Vector3f::Zero(), Eigen::Vector3f::Zero()};
        x[from][axis] = 1;
        const Eigen::Vector3f residual = corner.weight * corner.Residual(x[0], x[1], x[2]);
        for (uint32_t to = 0; to < 3; ++to) {
          out.block<3, 1>(3 * corner.vertex[to], 3 * corner.vertex[from] + axis) +=
              corner.Transposed(to, residual).cast<double>();
        }
      }
    }
  }
  return out;
}

TEST(InterTerm, CurvatureIsSymmetricPositiveSemidefinite) {
  for (uint64_t seed = 0; seed < kSeeds; ++seed) {
    const TriangleMesh mesh = RandomLabelledMesh(seed);
    const InterTerm term = TermOf(mesh);
    const InterCurvature curvature = term.Curvature(mesh.vertices, 0.7);
    const MatrixXd dense = Dense(curvature, mesh.vertices.size());
    const double scale = dense.cwiseAbs().maxCoeff();
    EXPECT_LT((dense - dense.transpose()).cwiseAbs().maxCoeff(), 1e-6 * scale);
    const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(0.5 * (dense + dense.transpose()), Eigen::EigenvaluesOnly);
    EXPECT_GT(eigen.eigenvalues().minCoeff(), -1e-5 * scale);
    EXPECT_GT(eigen.eigenvalues().maxCoeff(), 0.1);
    const CornerIncidence& incidence = curvature.incidence;
    for (size_t i = 0; i < incidence.vertices.size(); ++i) {
      Matrix3d block = Matrix3d::Zero();
      for (uint32_t e = incidence.begin[i]; e < incidence.begin[i + 1]; ++e) {
        block += curvature.corners[incidence.entries[e] / 3].Block(incidence.entries[e] % 3).cast<double>();
      }
      const uint32_t v = incidence.vertices[i];
      EXPECT_LT((block - dense.block<3, 3>(3 * v, 3 * v)).norm(), 1e-5 * scale);
    }
  }
}

// Rotates directions by any angle with fixed lengths: the energy stays below its tangent parabola.
TEST(InterTerm, CurvatureBoundsTheEnergyOnTheUnitSphere) {
  Random random(4);
  const TriangleMesh mesh = Sheet([](double) { return 0.0; });
  const InterTerm whole = TermOf(mesh);
  const auto corner = whole.corners()[3];
  TriangleMesh lone = mesh;  // labels with only this corner
  for (size_t f = 0; f < lone.faces.size(); ++f) {
    const auto& t = lone.faces[f];
    if (std::count(t.begin(), t.end(), corner[0]) == 0) lone.labels[f] = -1;
  }
  const InterTerm term = TermOf(lone);
  ASSERT_THAT(term.corners(), ElementsAre(corner));
  for (int trial = 0; trial < 2000; ++trial) {
    Positions v = lone.vertices;
    const double delta = random.Uniform(0, 2.4);  // beyond, the weight is limited
    const Vector3d a = RandomVector(random).normalized();
    const Vector3d binormal = a.cross(RandomVector(random)).normalized();
    const Vector3d b = Eigen::AngleAxisd(M_PI - delta, binormal) * a;
    v[corner[0]].setZero();
    v[corner[1]] = a;
    v[corner[2]] = b;
    const MatrixXd curvature = Dense(term.Curvature(v, 1), v.size());
    const double h = 1e-3;
    Positions plus = v, minus = v;
    VectorXd move = VectorXd::Zero(3 * v.size());
    for (int end : {1, 2}) {
      const Vector3d unit = v[corner[end]];
      const Vector3d axis = h * RandomVector(random);
      plus[corner[end]] = Eigen::AngleAxisd(axis.norm(), axis.normalized()) * unit;
      minus[corner[end]] = Eigen::AngleAxisd(-axis.norm(), axis.normalized()) * unit;
      move.segment<3>(3 * corner[end]) = 0.5 * (plus[corner[end]] - minus[corner[end]]);
    }
    // Great circles require axes perpendicular to the direction; other axes add a part of the gradient, which is
    // removed.
    const Positions gradient = Gradient(term, v);
    double slope = 0;
    for (int end : {1, 2}) {
      slope += gradient[corner[end]].dot(plus[corner[end]] + minus[corner[end]] - 2 * v[corner[end]]);
    }
    const double second = term.Energy(plus) + term.Energy(minus) - 2 * term.Energy(v) - slope;
    const double bound = move.dot(curvature * move);
    EXPECT_LE(second, bound * (1 + 1e-4) + 2e-3 * move.squaredNorm()) << delta;
  }
}

TEST(InterTerm, NewtonStepsStraightenABorder) {
  Random random(9);
  const TriangleMesh mesh = Sheet([](double) { return 0.0; });
  std::vector<uint8_t> fixed(mesh.vertices.size());
  const InterTerm term = TermOf(mesh);
  Positions v = mesh.vertices;
  for (Vector3d& p : v) p += 0.3 * RandomVector(random);
  const double start = term.Energy(v);
  double energy = start;
  constexpr double kMaxStep = 0.25;  // in edge lengths, as in the descent
  for (int i = 0; i < 40; ++i) {
    const Positions gradient = Gradient(term, v);
    MatrixXd system = Dense(term.Curvature(v, 1), v.size());
    system.diagonal().array() += 0.05;
    VectorXd rhs(3 * v.size());
    for (size_t k = 0; k < v.size(); ++k) rhs.segment<3>(3 * k) = -gradient[k];
    const VectorXd step = system.ldlt().solve(rhs);
    for (size_t k = 0; k < v.size(); ++k) {
      const Vector3d move = step.segment<3>(3 * k);
      v[k] += move * std::min(1.0, kMaxStep / std::max(move.norm(), 1e-30));
    }
    EXPECT_LE(term.Energy(v), energy + 1e-12);
    energy = term.Energy(v);
  }
  EXPECT_GT(start, 1);
  EXPECT_LT(energy, 0.02 * start);
}

TEST(InterTerm, ResultIsIndependentOfThreads) {
  TriangleMesh mesh = HeightField(90, 40, [](double x, double y) { return std::sin(x) + std::cos(1.3 * y); });
  Random random(6);
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    mesh.labels.push_back(static_cast<int32_t>(f / 2 % 90 / 5 + f / 180 / 5) % 3);
  }
  const InterTerm term = TermOf(mesh);
  ASSERT_GT(term.corners().size(), 2048u / 2);
  Positions gradient[2];
  double energy[2];
  for (int threads : {1, 2}) {
    const ThreadLimit limit(threads);
    gradient[threads - 1] = Gradient(term, mesh.vertices);
    energy[threads - 1] = term.Energy(mesh.vertices);
  }
  EXPECT_EQ(energy[0], energy[1]);
  EXPECT_EQ(gradient[0], gradient[1]);
}

}  // namespace
}  // namespace tessera
