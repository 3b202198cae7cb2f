#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "common/base/parallel.h"
#include "common/exporting/color/color_sheet.h"
#include "common/exporting/color/point_colors.h"
#include "common/exporting/color/vertex_colors.h"
#include "common/exporting/sheet_border.h"
#include "common/geometry/ray_caster.h"
#include "common/imaging/image_io.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

using Eigen::Vector3d;
using Paint = std::function<Rgb(const Vector3d&)>;

constexpr Rgb kTowerRed = {220, 30, 30};

Rgb PaintedGround(const Vector3d& p) {
  return {60, static_cast<uint8_t>(128 + 5 * p.x()), static_cast<uint8_t>(128 + 5 * p.y())};
}

Rgb PaintedTown(const Vector3d& p) { return p.z() > 0.01 ? kTowerRed : PaintedGround(p); }

// A square of ground of 20 x 20 m around the origin, of vertices at half metres.
Sheet ColorGround() {
  Sheet sheet;
  constexpr uint32_t kSide = 41;
  for (uint32_t y = 0; y < kSide; ++y) {
    for (uint32_t x = 0; x < kSide; ++x) sheet.vertices.emplace_back(0.5 * x - 10, 0.5 * y - 10, 0);
  }
  for (uint32_t y = 0; y + 1 < kSide; ++y) {
    for (uint32_t x = 0; x + 1 < kSide; ++x) {
      const uint32_t a = y * kSide + x;
      sheet.faces.push_back({a, a + 1, a + kSide + 1});
      sheet.faces.push_back({a, a + kSide + 1, a + kSide});
    }
  }
  sheet.labels.assign(sheet.faces.size(), 0);
  return sheet;
}

// A box of 4 x 4 x 10 m on the ground around the origin, without bottom.
Sheet ColorTower() {
  Sheet sheet;
  for (int i = 0; i < 8; ++i) sheet.vertices.emplace_back(i & 1 ? 2 : -2, i & 2 ? 2 : -2, i & 4 ? 10 : 0);
  sheet.faces = {{0, 1, 5}, {0, 5, 4}, {1, 3, 7}, {1, 7, 5}, {3, 2, 6},
                 {3, 6, 7}, {2, 0, 4}, {2, 4, 6}, {4, 5, 7}, {4, 7, 6}};
  sheet.labels.assign(sheet.faces.size(), 1);
  return sheet;
}

// A camera at `centre` that looks at `target`, 200 x 200 pixels.
SceneView LookingAt(const std::string& name, const Vector3d& centre, const Vector3d& target, double focal_px = 220) {
  SceneView view;
  view.name = name;
  PosedCamera& camera = view.camera;
  camera.intrinsics = {200, 200, focal_px, focal_px, 100, 100};
  view.lens.pinhole = camera.intrinsics;
  const Vector3d z = (target - centre).normalized();
  const Vector3d x = z.cross(std::abs(z.z()) > 0.9 ? Vector3d::UnitY() : Vector3d::UnitZ()).normalized();
  camera.rotation_cam_from_world.row(0) = x;
  camera.rotation_cam_from_world.row(1) = z.cross(x);
  camera.rotation_cam_from_world.row(2) = z;
  camera.translation_cam_from_world = -camera.rotation_cam_from_world * centre;
  return view;
}

// Painted surfaces, views of them and their photographs in a temporary folder.
class PaintedScene {
 public:
  explicit PaintedScene(std::vector<Sheet> sheets, Paint paint) : sheets_(std::move(sheets)), paint_(std::move(paint)) {
    for (const Sheet& sheet : sheets_) casters_.emplace_back(sheet.mesh());
  }

  void Add(const SceneView& view, const Paint& paint) {
    ByteImage image(200, 200, 3, 0);
    for (int y = 0; y < 200; ++y) {
      for (int x = 0; x < 200; ++x) {
        const Vector3d from = view.camera.Centre(), ray = view.camera.Ray(x + 0.5, y + 0.5);
        double distance = std::numeric_limits<double>::infinity();
        for (const RayCaster& caster : casters_) {
          if (const RayHit hit = caster.Cast(from, ray); hit.hit()) distance = std::min(distance, hit.distance);
        }
        // The ground goes on around the sheets.
        if (!std::isfinite(distance)) distance = -from.z() / ray.z();
        const Rgb color = paint(from + distance * ray);
        for (int c = 0; c < 3; ++c) image.at(x, y, c) = color[c];
      }
    }
    files_.push_back(folder_.path() + "/" + view.name + ".png");
    EXPECT_TRUE(WritePng(files_.back(), image).ok());
    masks_.push_back("");
    views_.push_back(view);
  }
  void Add(const SceneView& view) { Add(view, paint_); }

  // Hides the columns from `from` on in the last view.
  void Mask(int from) {
    ByteImage mask(200, 200, 1, 255);
    for (int y = 0; y < 200; ++y) {
      for (int x = from; x < 200; ++x) mask.at(x, y) = 0;
    }
    masks_.back() = files_.back() + ".mask.png";
    EXPECT_TRUE(WritePng(masks_.back(), mask).ok());
  }

  // The first sheet is coloured, the others are its neighbours.
  SheetInput Input() const {
    SheetInput input{.scene = scene_,
                     .options = options_,
                     .id = {},
                     .sheet = sheets_[0],
                     .neighbours = {sheets_.begin() + 1, sheets_.end()},
                     .start = {},
                     .views = views_,
                     .view_files = files_,
                     .mask_files = masks_};
    return input;
  }

  const std::vector<Vector3d>& vertices() const { return sheets_[0].vertices; }

 private:
  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  ExportScene scene_;
  ExportOptions options_;
  std::vector<Sheet> sheets_;
  Paint paint_;
  std::vector<RayCaster> casters_;
  std::vector<SceneView> views_;
  std::vector<std::string> files_, masks_;
};

std::vector<Rgb> ColorsOf(const SheetInput& input, double* unseen_share = nullptr) {
  std::vector<Rgb> colors;
  const Status status = ColorSheet(input, &colors, {}, unseen_share);
  EXPECT_TRUE(status.ok()) << status;
  return colors;
}

int Difference(const Rgb& a, const Rgb& b) {
  int most = 0;
  for (int c = 0; c < 3; ++c) most = std::max(most, std::abs(a[c] - b[c]));
  return most;
}

// The largest difference from PaintedGround of the vertices for which `counts` is true.
int GroundError(const PaintedScene& scene, const std::vector<Rgb>& colors,
                const std::function<bool(const Vector3d&)>& counts) {
  int most = 0;
  for (size_t v = 0; v < colors.size(); ++v) {
    const Vector3d& p = scene.vertices()[v];
    if (counts(p)) most = std::max(most, Difference(colors[v], PaintedGround(p)));
  }
  return most;
}

bool IsBesideTower(const Vector3d& p) { return std::max(std::abs(p.x()), std::abs(p.y())) > 2.6; }

std::vector<SceneView> ViewsAround() {
  std::vector<SceneView> views = {LookingAt("nadir", {0.3, 0.2, 40}, {0, 0, 0})};
  for (int i = 0; i < 6; ++i) {
    const double turn = i * M_PI / 3 + 0.1;
    views.push_back(
        LookingAt("oblique" + std::to_string(i), {25 * std::cos(turn), 25 * std::sin(turn), 35.0 - i}, {0, 0, 0}));
  }
  return views;
}

TEST(ColorSheetTest, RecoversThePaintAndKeepsTheTowersColourOffTheGround) {
  PaintedScene scene({ColorGround(), ColorTower()}, PaintedTown);
  for (const SceneView& view : ViewsAround()) scene.Add(view);
  double unseen = 1;
  const std::vector<Rgb> colors = ColorsOf(scene.Input(), &unseen);
  EXPECT_LE(GroundError(scene, colors, IsBesideTower), 4);
  EXPECT_GT(unseen, 0.01);  // beneath the tower
  EXPECT_LT(unseen, 0.06);
}

TEST(ColorSheetTest, DoesNotUseAViewThatATowerHides) {
  PaintedScene scene({ColorGround(), ColorTower()}, PaintedTown);
  scene.Add(LookingAt("near", {20, 0, 20}, {0, 0, 0}));
  scene.Add(LookingAt("far", {-40, 0, 40}, {0, 0, 0}));
  // The tower's shadow from the first view.
  const auto is_hidden = [](const Vector3d& p) { return p.x() < -2.6 && p.x() > -8 && std::abs(p.y()) < 1.5; };
  EXPECT_LE(GroundError(scene, ColorsOf(scene.Input()), is_hidden), 4);

  SheetInput transparent = scene.Input();
  transparent.neighbours.clear();
  EXPECT_GT(GroundError(scene, ColorsOf(transparent), is_hidden), 50);
}

TEST(ColorSheetTest, TakesTheMedianSoThatOneWrongPhotographDoesNotCount) {
  PaintedScene scene({ColorGround()}, PaintedGround);
  for (const SceneView& view : ViewsAround()) {
    scene.Add(view, view.name == "oblique1" ? [](const Vector3d&) { return Rgb{255, 0, 255}; } : Paint(PaintedGround));
  }
  EXPECT_LE(GroundError(scene, ColorsOf(scene.Input()), [](const Vector3d&) { return true; }), 8);
}

TEST(ColorSheetTest, DoesNotUseMaskedPixels) {
  PaintedScene scene({ColorGround()}, PaintedGround);
  scene.Add(LookingAt("nadir", {0, 0, 30}, {0, 0, 0}), [](const Vector3d& p) {
    return p.x() > 1 ? Rgb{255, 0, 255} : PaintedGround(p);
  });
  scene.Add(LookingAt("far", {0, 0, 60}, {0, 0, 0}));
  SheetInput input = scene.Input();
  EXPECT_GT(GroundError(scene, ColorsOf(input), [](const Vector3d&) { return true; }), 50);
  PaintedScene masked({ColorGround()}, PaintedGround);
  masked.Add(input.views[1]);
  masked.Add(input.views[0], [](const Vector3d& p) { return p.x() > 1 ? Rgb{255, 0, 255} : PaintedGround(p); });
  masked.Mask(100);
  EXPECT_LE(GroundError(masked, ColorsOf(masked.Input()), [](const Vector3d&) { return true; }), 4);
}

TEST(ColorSheetTest, FadesAViewOutAtItsRim) {
  PaintedScene scene({ColorGround()}, PaintedGround);
  // The image of the first view ends at x = 5.26 m, and fades from 4.74 m on. It is brighter.
  const SceneView narrow = LookingAt("narrow", {0, 0, 30}, {0, 0, 0}, 570);
  const SceneView wide = LookingAt("wide", {0, 0, 45}, {0, 0, 0}, 600);
  scene.Add(narrow, [](const Vector3d& p) {
    Rgb color = PaintedGround(p);
    color[0] = 160;
    return color;
  });
  scene.Add(wide);
  const std::vector<Rgb> colors = ColorsOf(scene.Input());
  int inside = 0, outside = 0, largest_step = 0;
  for (size_t v = 0; v + 1 < colors.size(); ++v) {
    const Vector3d &p = scene.vertices()[v], &q = scene.vertices()[v + 1];
    if (p.y() != 0 || q.y() != 0) continue;
    if (p.x() == 0) inside = colors[v][0];
    if (p.x() == 7) outside = colors[v][0];
    largest_step = std::max(largest_step, std::abs(colors[v][0] - colors[v + 1][0]));
  }
  EXPECT_GT(inside, 120);
  EXPECT_EQ(outside, 60);
  EXPECT_LT(largest_step, 0.85 * (inside - outside));
}

TEST(ColorSheetTest, GivesUnseenVerticesTheColourOfTheirNeighbours) {
  PaintedScene scene({ColorGround()}, [](const Vector3d&) { return Rgb{10, 200, 30}; });
  scene.Add(LookingAt("narrow", {0, 0, 30}, {0, 0, 0}, 600));
  double unseen = 0;
  const std::vector<Rgb> colors = ColorsOf(scene.Input(), &unseen);
  EXPECT_GT(unseen, 0.5);
  EXPECT_THAT(colors, testing::Each(Rgb{10, 200, 30}));

  SheetInput blind = scene.Input();
  blind.views.clear();
  blind.view_files.clear();
  blind.mask_files.clear();
  EXPECT_THAT(ColorsOf(blind, &unseen), testing::Each(kUnknownColor));
  EXPECT_EQ(unseen, 1);
}

TEST(ColorSheetTest, DoesNotDependOnTheOrderOfViewsOrTheNumberOfThreads) {
  PaintedScene scene({ColorGround(), ColorTower()}, PaintedTown);
  for (const SceneView& view : ViewsAround()) scene.Add(view);
  const SheetInput input = scene.Input();
  SheetInput reversed = scene.Input();
  std::reverse(reversed.views.begin(), reversed.views.end());
  std::reverse(reversed.view_files.begin(), reversed.view_files.end());
  const std::vector<Rgb> colors = ColorsOf(input);
  EXPECT_EQ(ColorsOf(reversed), colors);
  const ThreadLimit limit(1);
  EXPECT_EQ(ColorsOf(input), colors);
}

TEST(ColorSheetTest, GivesVerticesOfTheBorderOneColourInBothSheets) {
  const Sheet ground = ColorGround();
  Sheet west = ground, east = ground;
  for (Sheet* half : {&west, &east}) {
    half->faces.clear();
    for (size_t f = 0; f < ground.faces.size(); ++f) {
      if ((ground.mesh().Centroid(f).x() < 0) == (half == &west)) half->faces.push_back(ground.faces[f]);
    }
    // A relief, so that normals on the border depend on both sheets.
    for (Vector3d& p : half->vertices) p.z() = 0.8 * std::sin(2 * p.x() + p.y());
    half->labels.assign(half->faces.size(), 0);
  }
  PaintedScene scene({west, east}, PaintedGround);
  for (const SceneView& view : ViewsAround()) {
    scene.Add(view, [&](const Vector3d& p) {
      return Rgb{static_cast<uint8_t>(40 * (view.name.back() % 5)), static_cast<uint8_t>(128 + 5 * p.x()), 0};
    });
  }
  const SheetInput input = scene.Input();
  SheetInput other = scene.Input();
  std::swap(other.sheet, other.neighbours[0]);
  const std::vector<Rgb> of_west = ColorsOf(input), of_east = ColorsOf(other);
  int compared = 0;
  for (size_t v = 0; v < of_west.size(); ++v) {
    if (ground.vertices[v].x() != 0) continue;
    EXPECT_LE(Difference(of_west[v], of_east[v]), 1) << v;
    ++compared;
  }
  EXPECT_EQ(compared, 41);
}

TEST(PointColorsTest, AveragesPixelsUpToTheSpacingOfThePoints) {
  PaintedScene scene({ColorGround()}, PaintedGround);
  // Stripes of one pixel: black and white.
  scene.Add(LookingAt("stripes", {0, 0, 30}, {0, 0, 0}), [](const Vector3d& p) {
    return std::lround(std::floor(p.x() * 220 / 30)) % 2 == 0 ? Rgb{255, 255, 255} : Rgb{};
  });
  SheetInput input = scene.Input();
  const std::vector<Vector3d> points = {{0.07, 1, 0}, {0.2, 1, 0}, {0.34, 1, 0}};
  const std::vector<Eigen::Vector3f> normals(points.size(), Eigen::Vector3f::UnitZ());
  const std::vector<float> spacing_m(points.size(), 0.7f);  // five pixels
  const MeshSpans occluder = input.sheet.mesh();
  PointColorInput in{points, normals, {&occluder, 1}, input.views, input.view_files, input.mask_files};
  std::vector<Rgb> colors;
  std::vector<uint8_t> seen;
  ASSERT_TRUE(ColorPoints(in, &colors, &seen, {}).ok());
  EXPECT_GT(Difference(colors[0], colors[1]), 150);
  in.spacing_m = spacing_m;
  ASSERT_TRUE(ColorPoints(in, &colors, &seen, {}).ok());
  EXPECT_THAT(seen, testing::Each(1));
  for (const Rgb& color : colors) EXPECT_NEAR(color[0], 128, 20);
}

TEST(PointColorsTest, RefusesArraysOfOtherSizesAndStopsWhenCancelled) {
  const std::vector<Vector3d> points(3, Vector3d::Zero());
  const std::vector<Eigen::Vector3f> normals(2, Eigen::Vector3f::UnitZ());
  std::vector<Rgb> colors;
  std::vector<uint8_t> seen;
  PointColorInput input;
  input.points = points;
  input.normals = normals;
  EXPECT_THAT(std::string(ColorPoints(input, &colors, &seen, {}).message()),
              testing::HasSubstr("found 2 normals, 0 spacings and 0 files for 3 points"));
  input.points = std::span(points).first(2);
  TaskControl control;
  control.cancelled = [] { return true; };
  EXPECT_EQ(ColorPoints(input, &colors, &seen, control).code(), absl::StatusCode::kCancelled);
}

ExportScene TwoClasses() {
  ExportScene scene;
  scene.gsd_m = 0.1;
  scene.classes = {{"ground", {10, 20, 30}}, {"<img src=x onerror=alert(1)>", {200, 100, 50}}};
  return scene;
}

TEST(VertexColorsTest, TakesTheClassOfTheLargestArea) {
  Sheet sheet;
  sheet.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -3, 0}, {9, 9, 9}};
  sheet.faces = {{0, 1, 2}, {0, 2, 3}, {0, 4, 1}};
  sheet.labels = {0, 0, 1};  // areas .5, .5 and 1.5
  EXPECT_EQ(VertexLabels(sheet), (std::vector<int32_t>{1, 1, 0, 0, 1, -1}));
  sheet.labels = {1, 0, -1};
  EXPECT_EQ(VertexLabels(sheet), (std::vector<int32_t>{-1, -1, 0, 0, -1, -1}));
  const std::vector<Rgb> colors = VertexColors(sheet, TwoClasses(), VertexColor::kClass);
  EXPECT_EQ(colors[0], kUnknownColor);
  EXPECT_EQ(colors[2], (Rgb{10, 20, 30}));
  EXPECT_EQ(ClassColor(TwoClasses(), 2), kUnknownColor);
}

TEST(VertexColorsTest, ScalesAreOrderedByLightnessAndClamped) {
  const auto lightness = [](const Rgb& c) { return 0.299 * c[0] + 0.587 * c[1] + 0.114 * c[2]; };
  for (int i = 0; i < 20; ++i) {
    EXPECT_LT(lightness(ConfidenceRgb(i / 20.0)), lightness(ConfidenceRgb((i + 1) / 20.0))) << i;
    EXPECT_GT(lightness(DisplacementRgb(0.05 * i, 0.1)), lightness(DisplacementRgb(0.05 * (i + 1), 0.1))) << i;
  }
  EXPECT_EQ(ConfidenceRgb(-1), ConfidenceRgb(0));
  EXPECT_EQ(ConfidenceRgb(2), (Rgb{253, 231, 37}));
  EXPECT_EQ(DisplacementRgb(5, 0.1), DisplacementRgb(kDisplacementScale_gsd * 0.1, 0.1));
}

TEST(VertexColorsTest, ColoursWhatTheSheetKnows) {
  Sheet sheet = ColorGround();
  EXPECT_THAT(VertexColors(sheet, TwoClasses(), VertexColor::kImage), testing::Each(kUnknownColor));
  EXPECT_THAT(VertexColors(sheet, TwoClasses(), VertexColor::kConfidence), testing::Each(kUnknownColor));
  sheet.confidence.assign(sheet.faces.size(), 0.5f);
  EXPECT_THAT(VertexColors(sheet, TwoClasses(), VertexColor::kConfidence), testing::Each(ConfidenceRgb(0.5)));
  sheet.displacement_m.assign(sheet.vertices.size(), 0.25f);
  EXPECT_THAT(VertexColors(sheet, TwoClasses(), VertexColor::kDisplacement), testing::Each(DisplacementRgb(0.25, 0.1)));
  sheet.colors.assign(sheet.vertices.size(), Rgb{1, 2, 3});
  EXPECT_THAT(VertexColors(sheet, TwoClasses(), VertexColor::kImage), testing::Each(Rgb{1, 2, 3}));
}

TEST(VertexColorsTest, LegendNamesClassesAndValues) {
  EXPECT_THAT(ColorLegend(TwoClasses(), VertexColor::kClass),
              testing::ElementsAre(LegendEntry{"ground", {10, 20, 30}},
                                   LegendEntry{"<img src=x onerror=alert(1)>", {200, 100, 50}}));
  const std::vector<LegendEntry> legend = ColorLegend(TwoClasses(), VertexColor::kDisplacement);
  ASSERT_EQ(legend.size(), 5u);
  EXPECT_EQ(legend[1], (LegendEntry{"0.25 m", DisplacementRgb(0.25, 0.1)}));
  EXPECT_EQ(legend[4].name, "1 m");
  EXPECT_EQ(ColorLegend(TwoClasses(), VertexColor::kConfidence)[3], (LegendEntry{"0.75", ConfidenceRgb(0.75)}));
  EXPECT_TRUE(ColorLegend(TwoClasses(), VertexColor::kImage).empty());
}

TEST(SheetBorderTest, FindsVerticesWhoseFacesDoNotSurroundThem) {
  const Sheet sheet = ColorGround();
  const std::vector<uint8_t> is_border = BorderVertices(sheet.vertices.size() + 1, sheet.faces);
  EXPECT_EQ(is_border.back(), 1);
  for (size_t v = 0; v < sheet.vertices.size(); ++v) {
    const Vector3d& p = sheet.vertices[v];
    EXPECT_EQ(is_border[v] != 0, std::max(std::abs(p.x()), std::abs(p.y())) == 10) << v;
  }
}

}  // namespace
}  // namespace tessera
