#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/base/parallel.h"
#include "common/render/annotation.h"
#include "common/render/coloring.h"
#include "common/render/framing.h"
#include "common/render/renderer.h"

namespace tessera {
namespace {

const Eigen::Vector3d kUp = Eigen::Vector3d::UnitZ();

// A box over [0, 8] x [0, 4] x [0, 2], moved by `origin`; its top has label 1, the rest 0.
TriangleMesh Box(const Eigen::Vector3d& origin = {0, 0, 0}) {
  TriangleMesh mesh;
  for (int i = 0; i < 8; ++i) {
    mesh.vertices.push_back(origin + Eigen::Vector3d(i & 1 ? 8 : 0, i & 2 ? 4 : 0, i & 4 ? 2 : 0));
  }
  mesh.faces = {{4, 5, 7}, {4, 7, 6}, {0, 3, 1}, {0, 2, 3}, {0, 1, 5}, {0, 5, 4},
                {2, 7, 3}, {2, 6, 7}, {0, 6, 2}, {0, 4, 6}, {1, 3, 7}, {1, 7, 5}};
  mesh.labels.assign(mesh.faces.size(), 0);
  mesh.labels[0] = mesh.labels[1] = 1;
  return mesh;
}

std::array<int, 3> PixelAt(const ByteImage& image, int x, int y) {
  return {image.at(x, y, 0), image.at(x, y, 1), image.at(x, y, 2)};
}

TEST(Framing, AllVerticesAreInTheImageAndFillIt) {
  for (const Eigen::Vector3d& origin : {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(3e5, 5e6, 40)}) {
    const TriangleMesh mesh = Box(origin);
    for (const PosedCamera& camera : {NadirCamera(mesh, kUp, 300, 200), ObliqueCamera(mesh, kUp, 0.7, 0.6, 300, 200)}) {
      double left = 1e9, right = -1e9, top = 1e9, bottom = -1e9;
      for (const Eigen::Vector3d& v : mesh.vertices) {
        const Eigen::Vector3d p = camera.Project(v);
        EXPECT_TRUE(camera.InImage(p)) << p.transpose();
        left = std::min(left, p.x());
        right = std::max(right, p.x());
        top = std::min(top, p.y());
        bottom = std::max(bottom, p.y());
      }
      EXPECT_TRUE(right - left > 0.9 * 300 || bottom - top > 0.9 * 200);
      EXPECT_NEAR(camera.rotation_cam_from_world.determinant(), 1, 1e-12);
    }
  }
}

TEST(Framing, NadirHasNorthUpAndObliqueFollowsAzimuth) {
  const TriangleMesh mesh = Box();
  const PosedCamera nadir = NadirCamera(mesh, kUp, 300, 200);
  EXPECT_LT(nadir.Project({4, 4, 2}).y(), nadir.Project({4, 0, 2}).y());
  EXPECT_LT(nadir.Project({0, 2, 2}).x(), nadir.Project({8, 2, 2}).x());
  const PosedCamera east = ObliqueCamera(mesh, kUp, std::numbers::pi / 2, 0.5, 300, 200);
  EXPECT_LT(east.Centre().x(), 0);
  EXPECT_GT(east.Centre().z(), 2);
  EXPECT_LT(east.Project({4, 2, 2}).y(), east.Project({4, 2, 0}).y());
}

TEST(Framing, ZoomKeepsTheCentreAndEnlarges) {
  const PinholeCamera camera{200, 100, 50, 60, 90, 40};
  const PosedCamera before{camera}, after{Zoomed(camera, 0.25, 0.5, 0.1)};
  const Eigen::Vector3d point = before.Ray(50, 50), next = before.Ray(51, 50);
  EXPECT_NEAR(after.Project(point).x(), 100, 1e-9);
  EXPECT_NEAR(after.Project(point).y(), 50, 1e-9);
  EXPECT_NEAR(after.Project(next).x() - after.Project(point).x(), 10, 1e-9);
}

TEST(Render, UnlitColoursAreExact) {
  const TriangleMesh mesh = Box();
  const RayCaster caster(mesh);
  const PosedCamera camera = NadirCamera(mesh, kUp, 120, 90);
  RenderOptions options;
  options.lit = false;
  const ByteImage image = Render(mesh, caster, camera, LabelColor(mesh, {{{10, 20, 30}}, {{200, 100, 50}}}), options);
  ASSERT_EQ(image.channels, 3);
  EXPECT_EQ(PixelAt(image, 60, 45), (std::array<int, 3>{200, 100, 50}));
  EXPECT_EQ(PixelAt(image, 0, 0), (std::array<int, 3>{255, 255, 255}));
}

TEST(Render, ShadingDependsOnOrientationAndOcclusion) {
  const TriangleMesh mesh = Box();
  const RayCaster caster(mesh);
  const PosedCamera camera = ObliqueCamera(mesh, kUp, 0.8, 0.6, 160, 120);
  const ByteImage image = Render(mesh, caster, camera, UniformColor(Color(1, 1, 1)), {});
  const auto shade_at = [&](const Eigen::Vector3d& p) {
    const Eigen::Vector3d q = camera.Project(p);
    return static_cast<int>(image.at(static_cast<int>(q.x()), static_cast<int>(q.y())));
  };
  const int top = shade_at({4, 2, 2}), west = shade_at({0, 2, 1}), south = shade_at({4, 0, 1});
  EXPECT_GT(top, south);
  EXPECT_NE(west, south);
  EXPECT_GT(south, 20);
}

TEST(Render, AnyNumberOfThreadsGivesTheSame) {
  const TriangleMesh mesh = Box();
  const RayCaster caster(mesh);
  const PosedCamera camera = ObliqueCamera(mesh, kUp, 0.8, 0.6, 80, 60);
  const auto draw = [&](int threads) {
    const ThreadLimit limit(threads);
    return Render(mesh, caster, camera, NormalColor(mesh), {}).data;
  };
  EXPECT_EQ(draw(1), draw(4));
}

TEST(Render, EdgesAreDark) {
  const TriangleMesh mesh = Box();
  const RayCaster caster(mesh);
  const PosedCamera camera = NadirCamera(mesh, kUp, 120, 90);
  RenderOptions options;
  options.lit = false;
  options.edges = true;
  const ByteImage image = Render(mesh, caster, camera, UniformColor(Color(1, 1, 1)), options);
  const Eigen::Vector3d on_diagonal = camera.Project({4, 2, 2}), beside = camera.Project({2, 3, 2});
  int darkest = 255;
  for (int dy = -1; dy <= 1; ++dy) {
    darkest =
        std::min<int>(darkest, image.at(static_cast<int>(on_diagonal.x()), static_cast<int>(on_diagonal.y()) + dy));
  }
  EXPECT_LT(darkest, 200);
  EXPECT_EQ(image.at(static_cast<int>(beside.x()), static_cast<int>(beside.y())), 255);
}

TEST(Coloring, DisplacementIsSignedByTheReferencesNormal) {
  const TriangleMesh mesh = Box();
  const NearestSurface surface(mesh);
  EXPECT_NEAR(SignedDistance({4, 2, 2.3}, mesh, surface), 0.3, 1e-12);
  EXPECT_NEAR(SignedDistance({4, 2, 1.8}, mesh, surface), -0.2, 1e-12);
  const SurfaceColor color = DisplacementColor(mesh, surface, 0.3);
  EXPECT_EQ(color(0, {4, 2, 2.3}), DivergingColor(1));
  EXPECT_EQ(color(0, {4, 2, 2.9}), DivergingColor(1));
  EXPECT_GT(DivergingColor(1).x(), DivergingColor(1).z());
  EXPECT_GT(DivergingColor(-1).z(), DivergingColor(-1).x());
  EXPECT_NEAR(DivergingColor(0).x(), DivergingColor(0).z(), 1e-6);
}

TEST(Coloring, RangeIsRoundAndCovers90Percent) {
  const TriangleMesh reference = Box();
  TriangleMesh moved = Box();
  for (Eigen::Vector3d& v : moved.vertices) v *= 1.05;
  const double range_m = DisplacementRange(moved, NearestSurface(reference));
  EXPECT_DOUBLE_EQ(range_m, 0.5);
  EXPECT_GT(DisplacementRange(reference, NearestSurface(reference)), 0);
}

TEST(Coloring, WrongLabelsAreRed) {
  const TriangleMesh truth = Box();
  TriangleMesh mesh = truth;
  mesh.labels[1] = 0;
  const NearestSurface surface(truth);
  const SurfaceColor color = LabelErrorColor(mesh, truth, surface);
  const Color right = color(0, {6, 1, 2}), wrong = color(1, {2, 3, 2});
  EXPECT_EQ(right.x(), right.y());
  EXPECT_GT(wrong.x(), 2 * wrong.y());
}

TEST(Annotation, SideBySideKeepsBothImages) {
  const ByteImage left(30, 20, 3, 10), right(40, 20, 3, 200);
  const ByteImage both = SideBySide(left, right);
  EXPECT_EQ(both.height, 20);
  EXPECT_GT(both.width, 70);
  EXPECT_EQ(PixelAt(both, 29, 19), (std::array<int, 3>{10, 10, 10}));
  EXPECT_EQ(PixelAt(both, 30, 10), (std::array<int, 3>{255, 255, 255}));
  EXPECT_EQ(PixelAt(both, both.width - 1, 0), (std::array<int, 3>{200, 200, 200}));
}

TEST(Annotation, DrawsOnlyInItsArea) {
  ByteImage image(400, 300, 3, 120);
  DrawCaption(&image, "before");
  EXPECT_NE(*std::min_element(image.data.begin(), image.data.end()), 120);
  EXPECT_EQ(PixelAt(image, 399, 299), (std::array<int, 3>{120, 120, 120}));
  ByteImage bar(400, 300, 3, 120);
  DrawDisplacementBar(&bar, 0.2);
  EXPECT_EQ(PixelAt(bar, 200, 20), (std::array<int, 3>{120, 120, 120}));
  int blue = 0, red = 0;
  for (int y = 200; y < 300; ++y) {
    for (int x = 0; x < 400; ++x) {
      blue += bar.at(x, y, 2) > bar.at(x, y, 0) + 60;
      red += bar.at(x, y, 0) > bar.at(x, y, 2) + 60;
    }
  }
  EXPECT_GT(blue, 100);
  EXPECT_GT(red, 100);
  ByteImage legend(400, 300, 3, 120);
  DrawLegend(&legend, {{"roof", {250, 200, 0}}});
  int swatch = 0;
  for (int y = 0; y < 300; ++y) {
    for (int x = 0; x < 400; ++x) swatch += PixelAt(legend, x, y) == std::array<int, 3>{250, 200, 0};
  }
  EXPECT_GT(swatch, 20);
}

TEST(Annotation, TinyImagesDoNotFail) {
  ByteImage image(3, 2, 3, 0);
  DrawCaption(&image, "text");
  DrawDisplacementBar(&image, 1);
  DrawLegend(&image, {{"a", {1, 2, 3}}});
  EXPECT_EQ(image.data.size(), 18u);
}

}  // namespace
}  // namespace tessera
