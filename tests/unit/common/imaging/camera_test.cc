#include "common/imaging/camera.h"

#include <gtest/gtest.h>

#include <cmath>

namespace tessera {
namespace {

LensModel Model(std::initializer_list<double> coefficients) {
  LensModel lens;
  lens.kind = LensModel::Kind::kFullOpenCv;
  lens.pinhole = {1000, 800, 900, 950, 510, 390};
  std::copy(coefficients.begin(), coefficients.end(), lens.coefficients);
  return lens;
}

TEST(LensModelTest, PinholeIsIdentity) {
  LensModel lens = Model({});
  lens.kind = LensModel::Kind::kPinhole;
  EXPECT_EQ(lens.Distort({12.25, 700.5}), Eigen::Vector2d(12.25, 700.5));
}

TEST(LensModelTest, PrincipalPointIsFixed) {
  const LensModel lens = Model({-0.2, 0.1, 0.01, -0.02, 0.03, 0.1, 0.2, 0.3});
  EXPECT_NEAR((lens.Distort({510, 390}) - Eigen::Vector2d(510, 390)).norm(), 0, 1e-12);
}

// Numbers worked by hand from COLMAP's formulas at normalised (0.5, 0.25): r2 = 0.3125.
TEST(LensModelTest, TermsEqualColmaps) {
  const Eigen::Vector2d p(510 + 0.5 * 900, 390 + 0.25 * 950);
  const auto normalised = [](const Eigen::Vector2d& q) {
    return Eigen::Vector2d((q.x() - 510) / 900, (q.y() - 390) / 950);
  };
  const auto expect = [&](std::initializer_list<double> coefficients, double u, double v) {
    const Eigen::Vector2d q = normalised(Model(coefficients).Distort(p));
    EXPECT_NEAR(q.x(), u, 1e-12);
    EXPECT_NEAR(q.y(), v, 1e-12);
  };
  const double r2 = 0.3125;
  expect({0.2}, 0.5 * (1 + 0.2 * r2), 0.25 * (1 + 0.2 * r2));
  expect({0, 0.2}, 0.5 * (1 + 0.2 * r2 * r2), 0.25 * (1 + 0.2 * r2 * r2));
  expect({0, 0, 0.1}, 0.5 + 2 * 0.1 * 0.125, 0.25 + 0.1 * (r2 + 2 * 0.0625));
  expect({0, 0, 0, 0.1}, 0.5 + 0.1 * (r2 + 2 * 0.25), 0.25 + 2 * 0.1 * 0.125);
  expect({0, 0, 0, 0, 0.4}, 0.5 * (1 + 0.4 * r2 * r2 * r2), 0.25 * (1 + 0.4 * r2 * r2 * r2));
  expect({0, 0, 0, 0, 0, 0.4}, 0.5 / (1 + 0.4 * r2), 0.25 / (1 + 0.4 * r2));
  expect({0, 0, 0, 0, 0, 0, 0.4}, 0.5 / (1 + 0.4 * r2 * r2), 0.25 / (1 + 0.4 * r2 * r2));
  expect({0, 0, 0, 0, 0, 0, 0, 0.4}, 0.5 / (1 + 0.4 * r2 * r2 * r2), 0.25 / (1 + 0.4 * r2 * r2 * r2));
}

// Brown's model as photogrammetry states it (Brown 1971; Agisoft's manual): powers of the radius, then the tangential
// terms, then x + skew.
TEST(LensModelTest, BrownHasFourRadialTermsAndSkew) {
  LensModel lens = Model({-0.2, 0.11, 0.004, -0.003, -0.05, 0.09, 1.7});
  lens.kind = LensModel::Kind::kBrown;
  for (const Eigen::Vector2d& p : {Eigen::Vector2d(20, 700), Eigen::Vector2d(990, 30), Eigen::Vector2d(400, 410)}) {
    const double x = (p.x() - 510) / 900, y = (p.y() - 390) / 950, r = std::hypot(x, y);
    const double factor =
        1 - 0.2 * std::pow(r, 2) + 0.11 * std::pow(r, 4) - 0.05 * std::pow(r, 6) + 0.09 * std::pow(r, 8);
    const double xd = x * factor + 2 * 0.004 * x * y - 0.003 * (r * r + 2 * x * x);
    const double yd = y * factor + 0.004 * (r * r + 2 * y * y) - 2 * 0.003 * x * y;
    const Eigen::Vector2d q = lens.Distort(p);
    EXPECT_NEAR(q.x(), 510 + 900 * xd + 1.7 * yd, 1e-10);
    EXPECT_NEAR(q.y(), 390 + 950 * yd, 1e-10);
  }
}

TEST(LensModelTest, UndistortInvertsDistort) {
  for (const LensModel::Kind kind : {LensModel::Kind::kOpenCv, LensModel::Kind::kBrown}) {
    LensModel lens = Model({-0.2, 0.11, 0.004, -0.003});
    lens.kind = kind;
    if (kind == LensModel::Kind::kBrown) lens.coefficients[5] = 0.09, lens.coefficients[6] = 1.7;
    for (const Eigen::Vector2d& p : {Eigen::Vector2d(20, 700), Eigen::Vector2d(990, 30), Eigen::Vector2d(510, 390)}) {
      EXPECT_LT((lens.Undistort(lens.Distort(p)) - p).norm(), 0.01);
    }
  }
}

}  // namespace
}  // namespace tessera
