#include "common/imaging/camera.h"

#include <gtest/gtest.h>

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

}  // namespace
}  // namespace tessera
