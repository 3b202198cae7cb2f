#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "common/exporting/raster/surface_raster.h"
#include "common/geometry/ray_caster.h"
#include "tests/unit/common/exporting/raster_test_scene.h"

namespace tessera {
namespace {

std::vector<SheetId> SheetsAroundZero() { return {{-1, -1}, {0, -1}, {-1, 0}, {0, 0}}; }

TEST(RasterSurfaceTest, HasTheHighestPointOfAVerticalRay) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> place(0, 20), height(0, 10), edge(-3, 3);
  TriangleMesh mesh;
  for (uint32_t f = 0; f < 300; ++f) {
    const Eigen::Vector3d centre(place(random), place(random), height(random));
    for (int k = 0; k < 3; ++k)
      mesh.vertices.push_back(centre + Eigen::Vector3d(edge(random), edge(random), edge(random)));
    mesh.faces.push_back({3 * f, 3 * f + 1, 3 * f + 2});
  }
  const RasterBox box = {16, 16, 128, 160};
  const Eigen::Vector2d size(0.1, 0.1);
  const TopFaces top = FindTopFaces(mesh.vertices, mesh.faces, box, size);
  const RayCaster rays(mesh);
  int compared = 0, empty = 0;
  for (int row = 0; row < box.height; ++row) {
    for (int column = 0; column < box.width; ++column) {
      const Eigen::Vector3d above((16 + column + 0.5) * 0.1, (16 + 159 - row + 0.5) * 0.1, 100);
      const RayHit hit = rays.Cast(above, {0, 0, -1});
      bool at_an_edge = false;  // single precision may decide otherwise
      for (const Eigen::Vector3d& shift : {Eigen::Vector3d(1e-4, 1e-4, 0), Eigen::Vector3d(-1e-4, 1e-4, 0),
                                           Eigen::Vector3d(1e-4, -1e-4, 0), Eigen::Vector3d(-1e-4, -1e-4, 0)}) {
        at_an_edge |= rays.Cast(above + shift, {0, 0, -1}).face != hit.face;
      }
      if (at_an_edge) continue;
      const size_t pixel = static_cast<size_t>(row) * box.width + column;
      ASSERT_EQ(top.face[pixel], hit.face) << column << ", " << row;
      ++(hit.hit() ? compared : empty);
      if (!hit.hit()) continue;
      ASSERT_NEAR(top.height[pixel], 100 - hit.distance, 2e-4) << column << ", " << row;
    }
  }
  EXPECT_GT(compared, 15000);
  EXPECT_GT(empty, 100);
}

TEST(RasterSurfaceTest, HasNoGapsWhereCentresLieOnEdgesAndVertices) {
  // Vertices are at the centres of pixels, diagonals go through centres; coordinates are far from zero.
  const double x0 = 391234.05, y0 = 5820123.05;
  Sheet sheet = GridSheet(0, 0, 4, 4, 0.4, [](double, double) { return 5; });
  for (Eigen::Vector3d& p : sheet.vertices) p += Eigen::Vector3d(x0, y0, 0);
  const RasterBox box = {3912341, 58201231, 40, 40};
  const TopFaces top = FindTopFaces(sheet.vertices, sheet.faces, box, {0.1, 0.1});
  for (int row = 1; row < box.height; ++row) {
    for (int column = 0; column < box.width - 1; ++column) {
      EXPECT_EQ(top.height[static_cast<size_t>(row) * box.width + column], 5) << column << ", " << row;
    }
  }
}

TEST(RasterSurfaceTest, IgnoresVerticalAndDegenerateFacesAndThoseOutside) {
  const std::vector<Eigen::Vector3d> vertices = {{1, 1, 0}, {3, 1, 0}, {1, 1, 9}, {3, 1, 9}, {2, 1, 4}, {90, 90, 0}};
  const std::vector<Triangle> faces = {{0, 1, 2}, {1, 3, 2}, {0, 4, 1}, {5, 5, 5}, {0, 0, 1}};
  const TopFaces top = FindTopFaces(vertices, faces, {0, 0, 16, 16}, {0.4, 0.4});
  EXPECT_THAT(top.face, testing::Each(-1));
}

// Each pixel of the sheets around zero is in one of them.
void ExpectEachPixelOnce(const ExportScene& scene, const std::string& crs) {
  SCOPED_TRACE(crs);
  ExportOptions options;
  options.crs = crs;
  const StatusOr<RasterMap> map = RasterMap::Open(scene, options);
  ASSERT_TRUE(map.ok()) << map.status();
  std::map<std::pair<int64_t, int64_t>, int> count;
  for (const SheetId& id : SheetsAroundZero()) {
    const StatusOr<RasterBox> box = BoxOfSheet(*map, scene, id);
    ASSERT_TRUE(box.ok()) << box.status();
    EXPECT_EQ(((box->x0 % kRasterAlignment) + (box->y0 % kRasterAlignment) + box->width % kRasterAlignment +
               box->height % kRasterAlignment),
              0);
    const StatusOr<std::vector<uint8_t>> owned = PixelsOfSheet(*map, scene, id, *box);
    ASSERT_TRUE(owned.ok()) << owned.status();
    for (int row = 0; row < box->height; ++row) {
      for (int column = 0; column < box->width; ++column) {
        if (!(*owned)[static_cast<size_t>(row) * box->width + column]) continue;
        const bool at_rim = row == 0 || column == 0 || row == box->height - 1 || column == box->width - 1;
        EXPECT_FALSE(at_rim) << "the box cuts the sheet";
        ++count[{box->x0 + column, box->y0 + box->height - 1 - row}];
      }
    }
  }
  EXPECT_NEAR(static_cast<double>(count.size()), std::pow(256 / map->pixel_m(), 2), 0.02 * 512 * 512);
  for (const auto& [pixel, times] : count) ASSERT_EQ(times, 1) << pixel.first << ", " << pixel.second;
  // No pixel is missing: each row of pixels of a sheet is one run.
  std::map<int64_t, std::pair<int64_t, int64_t>> ends;
  std::map<int64_t, int64_t> sizes;
  for (const auto& [pixel, times] : count) {
    const auto [it, is_new] = ends.try_emplace(pixel.second, pixel.first, pixel.first);
    it->second = {std::min(it->second.first, pixel.first), std::max(it->second.second, pixel.first)};
    ++sizes[pixel.second];
  }
  for (const auto& [row, range] : ends) EXPECT_EQ(range.second - range.first + 1, sizes[row]) << row;
}

TEST(RasterGridTest, GivesEachPixelToOneSheet) {
  ExpectEachPixelOnce(LocalRasterScene(), "");
  ExpectEachPixelOnce(UtmRasterScene(), "");
  ExpectEachPixelOnce(UtmRasterScene(), "EPSG:32632");
  ExpectEachPixelOnce(EnuRasterScene(), "EPSG:32633");
  ExpectEachPixelOnce(EnuRasterScene(), "EPSG:4326");
}

TEST(RasterMapTest, ChoosesRoundPixelSizes) {
  ExportScene scene = UtmRasterScene();
  const auto size = [&](double scene_gsd_m, double gsd_m, const std::string& crs) {
    scene.gsd_m = scene_gsd_m;
    ExportOptions options;
    options.gsd_m = gsd_m;
    options.crs = crs;
    const StatusOr<RasterMap> map = RasterMap::Open(scene, options);
    EXPECT_TRUE(map.ok()) << map.status();
    return map->pixel_size();
  };
  EXPECT_EQ(size(0.083, 0, "").x(), 0.1);
  EXPECT_DOUBLE_EQ(size(0.0237, 0, "").x(), 0.025);
  EXPECT_DOUBLE_EQ(size(0.0189, 0, "").y(), 0.02);
  EXPECT_EQ(size(0.09, 0.125, "").y(), 0.125);
  EXPECT_NEAR(size(0.1, 0, "EPSG:4326").y(), 0.1 / 111270, 2e-9);
  EXPECT_GT(size(0.1, 0, "EPSG:4326").x(), 1.5 * size(0.1, 0, "EPSG:4326").y());  // at latitude 52
  EXPECT_EQ(size(0.5, 0.3048, "+proj=tmerc +lat_0=52 +lon_0=13 +datum=WGS84 +units=ft").x(), 1);
}

TEST(RasterMapTest, RefusesWhatNoRasterCanHave) {
  ExportOptions options;
  options.formats = {"dsm", "ortho"};
  options.crs = "EPSG:4978";
  const Status geocentric = CheckExport(options, EnuRasterScene());
  EXPECT_EQ(geocentric.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(geocentric.message()), testing::HasSubstr("such as EPSG:32633"));
  // Once, though both formats refuse it.
  EXPECT_THAT(std::string(geocentric.message()), testing::Not(testing::HasSubstr("\n")));
  options.crs = "";
  options.gsd_m = 0.01;
  EXPECT_THAT(std::string(CheckExport(options, EnuRasterScene()).message()),
              testing::HasSubstr("expected 0.125 to 128 m"));
  options.gsd_m = 0;
  EXPECT_TRUE(CheckExport(options, EnuRasterScene()).ok());
  ExportScene scene = EnuRasterScene();
  scene.classes.resize(256);
  EXPECT_TRUE(CheckExport(options, scene).ok());
  options.formats = {"classes"};
  EXPECT_THAT(std::string(CheckExport(options, scene).message()), testing::HasSubstr("expected at most 255"));
}

}  // namespace
}  // namespace tessera
