#include "worker/photo/contour_term.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

#include "common/base/parallel.h"
#include "common/base/random.h"
#include "tests/support/draw_views.h"
#include "tests/support/held_pixels.h"
#include "tests/support/make_texels.h"
#include "tests/support/refine_surface.h"
#include "worker/refine/descent.h"
#include "worker/refine/vertex_sums.h"

namespace tessera {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int kGround = 0, kBall = 1;
constexpr double kFocal_px = 200, kPi = 3.14159265358979323846;
constexpr int kAround = 48, kRows = 24;
const Vector3d kCentre(0, 0, 4.5);

// A ball 3 m above flat ground. The ground's vertices and faces come first.
struct ContourBed {
  TriangleMesh mesh;
  std::vector<int32_t> labels;
  uint32_t first_ball_vertex = 4;

  ContourBed() {
    for (const double y : {-20.0, 20.0}) {
      for (const double x : {-20.0, 20.0}) mesh.vertices.push_back({x, y, 0});
    }
    mesh.faces = {{0, 1, 3}, {0, 3, 2}};
    for (const double z : {3.0, -3.0}) mesh.vertices.push_back(kCentre + z * Vector3d::UnitZ());
    for (int row = 1; row < kRows; ++row) {
      const double height = std::cos(kPi * row / kRows), radius = std::sin(kPi * row / kRows);
      for (int k = 0; k < kAround; ++k) {
        const double angle = 2 * kPi * k / kAround;
        mesh.vertices.push_back(kCentre + 3 * Vector3d(radius * std::cos(angle), radius * std::sin(angle), height));
      }
    }
    const auto at = [](int row, int k) { return RingVertex(row, k % kAround); };
    for (int k = 0; k < kAround; ++k) {
      mesh.faces.push_back({4, at(1, k), at(1, k + 1)});
      mesh.faces.push_back({5, at(kRows - 1, k + 1), at(kRows - 1, k)});
      for (int row = 1; row + 1 < kRows; ++row) {
        mesh.faces.push_back({at(row, k), at(row + 1, k), at(row + 1, k + 1)});
        mesh.faces.push_back({at(row, k), at(row + 1, k + 1), at(row, k + 1)});
      }
    }
    labels.assign(mesh.faces.size(), kBall);
    labels[0] = labels[1] = kGround;
    mesh.labels = labels;
  }
  static uint32_t RingVertex(int row, int k) { return static_cast<uint32_t>(6 + (row - 1) * kAround + k); }
};

// 20 m above the ground and `aside` m to the side, looking at the ball.
PosedCamera Camera(double aside, int scale = 1) {
  const Vector3d centre(aside, 0.4 * aside, 20), z = (kCentre - centre).normalized();
  const Vector3d x = z.cross(Vector3d::UnitY()).normalized(), y = z.cross(x);
  PosedCamera camera;
  camera.intrinsics = {160 * scale, 128 * scale, kFocal_px * scale, kFocal_px * scale, 80.0 * scale, 64.0 * scale};
  camera.rotation_cam_from_world << x.transpose(), y.transpose(), z.transpose();
  camera.translation_cam_from_world = -camera.rotation_cam_from_world * centre;
  return camera;
}

// Distance of a pixel outside the silhouette of a ball of `radius` at `at`, metres at the ball.
double Outside_m(const PosedCamera& camera, double x, double y, double radius, const Vector3d& at) {
  const Vector3d ray = camera.Ray(x, y).normalized();
  return (at - camera.Centre()).cross(ray).norm() - radius;
}

// The ball's likelihood, which falls within a pixel.
double BallLikelihood(double outside_m) { return 0.05 + 0.9 / (1 + std::exp(outside_m / 0.02)); }

FloatImage Likelihoods(const PosedCamera& camera, double radius, const Vector3d& at = kCentre) {
  FloatImage image(camera.intrinsics.width, camera.intrinsics.height, 2);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const double ball = BallLikelihood(Outside_m(camera, x + 0.5, y + 0.5, radius, at));
      image.at(x, y, kBall) = static_cast<float>(ball);
      image.at(x, y, kGround) = static_cast<float>(1 - ball);
    }
  }
  return image;
}

// Image of a light ball without texture on dark ground.
FloatImage Photograph(const PosedCamera& camera, double radius, const Vector3d& at = kCentre) {
  constexpr int kParts = 4;
  FloatImage image(camera.intrinsics.width, camera.intrinsics.height);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      int inside = 0;
      for (int k = 0; k < kParts * kParts; ++k) {
        const double u = x + (k % kParts + 0.5) / kParts, v = y + (k / kParts + 0.5) / kParts;
        inside += Outside_m(camera, u, v, radius, at) < 0;
      }
      image.at(x, y) = 0.3f + 0.4f * static_cast<float>(inside) / (kParts * kParts);
    }
  }
  return image;
}

BorderTrusts Trusted() {
  BorderTrusts trusts(2);
  trusts.Set(kBall, kGround, {0, 0.5, 1});
  return trusts;
}

ContourOptions Options(double weight = 1, double gap_px = 4) { return {weight, gap_px, Trusted()}; }

PhotoView View(const PosedCamera& camera, double radius, const Vector3d& at) {
  return {camera, MakeTexels(Photograph(camera, radius, at), Likelihoods(camera, radius, at), PixelMapping())};
}

using Motion = std::function<Vector3d(const Vector3d&)>;

// Expected force along a motion of the ball: the sum over its contour, each pixel divided into parts, of the distance
// to the edge (at most two pixels) times the contour's motion in that direction.
double Pull(const ContourBed& bed, double aside, double radius, const Vector3d& at, const Motion& motion) {
  constexpr int kParts = 8, kFar = 4 * kParts;
  constexpr double kWorth = 0.9 * 0.5, kMost_px = 2, kStep = 1e-3;
  const PosedCamera camera = Camera(aside, kParts);
  const FaceMap map = RasterizeFaces(bed.mesh, camera);
  const auto index = [&](int x, int y) { return static_cast<size_t>(y) * map.width + x; };
  const auto ball = [&](int x, int y) { return bed.labels[map.face[index(x, y)]] == kBall; };
  double sum = 0;
  const auto add = [&](int x, int y, int dx, int dy) {
    if (ball(x, y) == ball(x + dx, y + dy)) return;
    if (!ball(x, y)) {
      x += dx, y += dy;
      dx = -dx, dy = -dy;
    }
    const auto outside = [&](int k) {
      return Outside_m(camera, x + 0.5 + dx * (0.5 + k), y + 0.5 + dy * (0.5 + k), radius, at);
    };
    for (int k = -kFar; k < kFar; ++k) {
      const double here = outside(k), next = outside(k + 1);
      if (here > 0 || next <= 0) continue;
      const double edge_px = (k + here / (here - next)) / kParts;
      const Vector3d seen = camera.Centre() + map.depth[index(x, y)] * camera.Ray(x + 0.5, y + 0.5);
      const Vector3d moved = kStep * motion(seen);
      const Vector3d along = (camera.Project(seen + moved) - camera.Project(seen - moved)) / (2 * kStep * kParts);
      sum += kWorth / kParts * std::clamp(edge_px, -kMost_px, kMost_px) * (dx * along.x() + dy * along.y());
    }
  };
  for (int y = 0; y + 1 < map.height; ++y) {
    for (int x = 0; x + 1 < map.width; ++x) {
      add(x, y, 1, 0);
      add(x, y, 0, 1);
    }
  }
  return sum;
}

struct Derivatives {
  std::vector<Vector3d> gradient;
  std::vector<Matrix3d> curvature;
};

Derivatives Evaluate(const ContourBed& bed, const std::vector<PhotoView>& views,
                     const ContourOptions& options = Options()) {
  std::vector<std::vector<FaceContour>> contours;
  std::vector<int32_t> ids;
  for (const PhotoView& view : views) {
    const FaceMap map = RasterizeFaces(bed.mesh, view.camera);
    contours.push_back(FindContours(bed.mesh, bed.labels, {}, view, map, options));
    ids.push_back(static_cast<int32_t>(10 + 3 * ids.size()));
  }
  PhotoDerivatives out = GatherVertices(bed.mesh, FacesOfVertices(bed.mesh),
                                        std::vector<FaceSums>(bed.mesh.faces.size()), AddContours(contours, ids));
  return {std::move(out.gradient), std::move(out.curvature)};
}

TEST(ContourTerm, ForceIsProportionalToTheDistanceOfTheEdge) {
  // Size and position of the ball in the images, and the motion.
  const struct {
    double radius;
    Vector3d at;
  } truths[] = {{3.12, kCentre}, {2.9, kCentre}, {3, kCentre + Vector3d(0.12, 0.06, 0)}};
  const Motion grow = [](const Vector3d& p) { return Vector3d((p - kCentre) / 3); };
  const Motion slide = [](const Vector3d&) { return Vector3d(0.8, 0.6, 0); };
  const Motion lift = [](const Vector3d&) { return Vector3d(0, 0, 1); };
  for (const double aside : {0.0, 9.0}) {
    for (const auto& [radius, at] : truths) {
      for (const Motion& motion : {grow, slide, lift}) {
        const ContourBed bed;
        const Derivatives d = Evaluate(bed, {View(Camera(aside), radius, at)});
        double along = 0, length = 0;
        for (size_t v = bed.first_ball_vertex; v < bed.mesh.vertices.size(); ++v) {
          const Vector3d move = motion(bed.mesh.vertices[v]);
          along += d.gradient[v].dot(move);
          length += d.gradient[v].norm() * move.norm();
        }
        EXPECT_NEAR(-along, Pull(bed, aside, radius, at, motion), 0.15 * length)
            << aside << " " << radius << " " << at.transpose();
        EXPECT_GT(length, 100);
      }
    }
  }
}

TEST(ContourTerm, NeedsDifferentLabelsAndADepthGap) {
  const std::vector<PhotoView> views = {View(Camera(4), 3.15, kCentre)};
  const auto pull = [&](const ContourBed& bed, const ContourOptions& options = Options()) {
    const Derivatives d = Evaluate(bed, views, options);
    double sum = 0;
    for (const Vector3d& g : d.gradient) sum += g.norm();
    for (uint32_t v = 0; v < bed.first_ball_vertex; ++v) EXPECT_EQ(d.gradient[v], Vector3d::Zero()) << "behind";
    return sum;
  };
  const ContourBed bed;
  EXPECT_GT(pull(bed), 0);
  ContourBed same = bed;
  std::fill(same.labels.begin(), same.labels.end(), kBall);
  EXPECT_EQ(pull(same), 0);
  ContourBed unknown = bed;
  std::fill(unknown.labels.begin(), unknown.labels.begin() + 2, -1);
  EXPECT_EQ(pull(unknown), 0);
  // Here 4 to 6 m of depth are 50 to 80 pixels.
  EXPECT_EQ(pull(bed, Options(1, 120)), 0);
  EXPECT_NEAR(pull(bed, Options(3)), 3 * pull(bed), 1e-6 * pull(bed));
  EXPECT_EQ(pull(bed, {1, 4}), 0) << "class borders without trust";
}

// The contours of some faces and those of the others add up to those of all.
TEST(ContourTerm, ContoursOfOwnFacesEqualThoseOfAllFaces) {
  const ContourBed bed;
  const PhotoView view = View(Camera(4), 3.15, kCentre);
  const FaceMap map = RasterizeFaces(bed.mesh, view.camera);
  std::vector<uint8_t> own(bed.mesh.faces.size()), others = own;
  for (size_t f = 0; f < own.size(); ++f) {
    own[f] = f % 3 == 0;
    others[f] = !own[f];
  }
  const auto find = [&](const std::vector<uint8_t>& flags) {
    return FindContours(bed.mesh, bed.labels, flags, view, map, Options());
  };
  const std::vector<FaceContour> all = find({}), some = find(own), rest = find(others);
  ASSERT_EQ(all.size(), some.size() + rest.size());
  ASSERT_GT(some.size(), 10u);
  size_t s = 0, r = 0;
  for (const FaceContour& contour : all) {
    const FaceContour& part = own[contour.face] ? some[s++] : rest[r++];
    EXPECT_EQ(contour.face, part.face);
    EXPECT_EQ(contour.gradient, part.gradient);
    EXPECT_EQ(contour.curvature, part.curvature);
  }
}

TEST(ContourTerm, CurvatureIsPositiveAtContours) {
  const ContourBed bed;
  const Derivatives d = Evaluate(bed, {View(Camera(4), 3.15, kCentre), View(Camera(-7), 2.9, kCentre)});
  for (size_t v = 0; v < bed.mesh.vertices.size(); ++v) {
    const Eigen::Vector3d values = d.curvature[v].selfadjointView<Eigen::Lower>().eigenvalues();
    EXPECT_GE(values.minCoeff(), -1e-9 * (1 + values.maxCoeff()));
    // A Newton step is bounded in pixels, since edges pull like at most 2 pixels.
    const double px = kFocal_px / 16;
    EXPECT_LE(d.gradient[v].norm(), 4 * values.maxCoeff() / px + 1e-9);
  }
}

// Many contours are added by ranges of faces. Each sum is that of its face alone, in the order of the views.
TEST(ContourTerm, ContoursAreAddedPerFaceInTheOrderOfTheViews) {
  constexpr int kViews = 5;
  constexpr uint32_t kFaces = 3000;
  Random random(2);
  std::vector<std::vector<FaceContour>> views(kViews + 1);  // the last has none
  std::vector<int32_t> ids;
  for (int v = 0; v <= kViews; ++v) ids.push_back(40 - 3 * v);
  for (uint32_t f = 7; f < kFaces; ++f) {
    for (int v = 0; v < kViews; ++v) {
      if (random.Below(3) == 0) continue;
      FaceContour& contour = views[v].emplace_back();
      contour.face = f;
      for (int c = 0; c < 3; ++c) {
        for (int k = 0; k < 3; ++k) contour.gradient[c][k] = random.Normal();
        for (int k = 0; k < 6; ++k) contour.curvature[c][k] = random.Normal();
      }
    }
  }
  for (const int threads : {1, 4}) {
    const ThreadLimit limit(threads);
    const ContourSums sums = AddContours(views, ids);
    size_t next = 0;
    for (uint32_t f = 0; f < kFaces; ++f) {
      std::vector<int32_t> expected_views;
      FaceContour expected;
      for (int c = 0; c < 3; ++c) {
        expected.gradient[c].setZero();
        expected.curvature[c].setZero();
      }
      for (int v = 0; v < kViews; ++v) {
        const auto at = std::find_if(views[v].begin(), views[v].end(), [&](const auto& c) { return c.face == f; });
        if (at == views[v].end()) continue;
        expected_views.push_back(ids[v]);
        for (int c = 0; c < 3; ++c) {
          expected.gradient[c] += at->gradient[c];
          expected.curvature[c] += at->curvature[c];
        }
      }
      if (expected_views.empty()) continue;
      ASSERT_LT(next, sums.faces.size());
      const FaceContour& got = sums.faces[next++];
      ASSERT_EQ(got.face, f);
      ASSERT_EQ(std::vector<int32_t>(sums.views.begin() + got.views_begin, sums.views.begin() + got.views_end),
                expected_views);
      EXPECT_EQ(got.gradient, expected.gradient) << f;
      EXPECT_EQ(got.curvature, expected.curvature) << f;
    }
    EXPECT_EQ(next, sums.faces.size());
    EXPECT_EQ(sums.faces.back().views_end, sums.views.size());
  }
  EXPECT_TRUE(AddContours({{}, {}}, {1, 2}).faces.empty());
}

// The ball's size is visible only in its silhouette.
TEST(ContourTerm, BallConvergesToItsSilhouette) {
  for (const double radius : {3.6, 2.5}) {
    const ContourBed bed;
    SurfaceProblem problem;
    problem.mesh = bed.mesh;
    problem.gsd_m = 16 / kFocal_px;
    for (const double aside : {-8.0, -3.0, 2.0, 7.0}) {
      const PosedCamera camera = Camera(aside);
      const FloatImage photograph = Photograph(camera, radius);
      problem.views.push_back({camera, std::make_shared<HeldPixels>(photograph, Likelihoods(camera, radius))});
    }
    problem.pairs = {{0, 1}, {1, 2}, {2, 3}, {3, 2}};
    problem.levels = {1, 0};
    problem.iterations = {6, 10};
    TileRefineOptions options;
    options.data.contour = 0.5;
    options.data.borders = Trusted();
    options.step.thin_plate = 0.0005;  // without data, smoothness alone would shrink the ball
    options.step.membrane = 0;
    std::vector<Vector3d> refined, again;
    for (const int threads : {1, 3}) {
      const ThreadLimit limit(threads);
      const StatusOr<SurfaceRefinement> result = RefineSurface(problem, options);
      ASSERT_TRUE(result.ok()) << result.status();
      (threads == 1 ? refined : again) = result->vertices;
    }
    EXPECT_EQ(refined, again);
    double mean = 0;
    for (int k = 0; k < kAround; ++k) {
      double widest = 0;
      for (int row = 1; row < kRows; ++row) {
        widest = std::max(widest, (refined[ContourBed::RingVertex(row, k)] - kCentre).head<2>().norm());
      }
      mean += widest / kAround;
    }
    EXPECT_NEAR(mean, radius, 0.75 * problem.gsd_m);
  }
}

}  // namespace
}  // namespace tessera
