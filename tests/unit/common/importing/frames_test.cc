#include "common/importing/frames.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "common/importing/proof/proof.h"
#include "tests/support/blocks/truth_block.h"

namespace tessera {
namespace {

using testing::HasSubstr;

constexpr double kFramesDegree = std::numbers::pi / 180;
// WGS 84, and UTM: the formulas of this test are apart from PROJ's.
constexpr double kSemiMajor_m = 6378137, kFlattening = 1 / 298.257223563;

// Textbook formulas of earth-centred coordinates and of east-north-up.
Eigen::Vector3d Geocentric(double lat_rad, double lon_rad, double height_m) {
  const double e2 = kFlattening * (2 - kFlattening);
  const double n = kSemiMajor_m / std::sqrt(1 - e2 * std::sin(lat_rad) * std::sin(lat_rad));
  return {(n + height_m) * std::cos(lat_rad) * std::cos(lon_rad),
          (n + height_m) * std::cos(lat_rad) * std::sin(lon_rad), (n * (1 - e2) + height_m) * std::sin(lat_rad)};
}
Eigen::Matrix3d EnuFromGeocentric(double lat_rad, double lon_rad) {
  Eigen::Matrix3d r;
  r << -std::sin(lon_rad), std::cos(lon_rad), 0,                                                          //
      -std::sin(lat_rad) * std::cos(lon_rad), -std::sin(lat_rad) * std::sin(lon_rad), std::cos(lat_rad),  //
      std::cos(lat_rad) * std::cos(lon_rad), std::cos(lat_rad) * std::sin(lon_rad), std::sin(lat_rad);
  return r;
}

SceneMap MapAt(const std::string& crs, FrameChoice choice, const Eigen::Vector3d& near,
               const Eigen::Vector3d& offset = Eigen::Vector3d::Zero()) {
  StatusOr<SceneMap> map = SceneMap::Choose({crs, offset}, choice, {}, near);
  EXPECT_TRUE(map.ok()) << map.status();
  return map.ok() ? *std::move(map) : *SceneMap::Choose({}, choice, {}, near);
}

Eigen::Vector3d InScene(const SceneMap& map, Eigen::Vector3d p) {
  const Status status = map.SceneFromSource({&p, 1});
  EXPECT_TRUE(status.ok()) << status;
  return p;
}

ImportedBlock BlockAt(const std::string& crs, const Eigen::Vector3d& centre) {
  TruthOptions options;
  options.centre = centre;
  ImportedBlock block = MakeTruthBlock(options);
  block.crs = crs;
  return block;
}

// Largest reprojection error of the tie points, pixels.
double LargestError_px(const ImportedBlock& block) {
  double largest = 0;
  for (const BlockTiePoint& point : block.points) {
    for (const BlockObservation& observation : point.observations) {
      const BlockImage& image = block.images[observation.image];
      largest = std::max(largest, (ProjectInBlock(block, image, point.position) - observation.position_px).norm());
    }
  }
  return largest;
}

// A block as a program writes it that adjusts in space: positions are mapped, poses are in the axes of the map at the
// camera. `truth`: east-north-up at the origin of `enu`.
ImportedBlock WrittenInGrid(ImportedBlock truth, const std::string& crs, const Eigen::Vector3d& near) {
  const ReferenceSystem enu = *ReferenceSystem::Of([&] {
    Crs at;
    at.kind = Crs::Kind::kEnu;
    at.lat_rad = 48.86 * kFramesDegree;
    at.lon_rad = 2.35 * kFramesDegree;
    return at;
  }());
  ReferenceSystem grid = *ReferenceSystem::Parse(crs);
  EXPECT_TRUE(grid.Locate(near).ok());
  const auto to_grid = [&](Eigen::Vector3d p) {
    EXPECT_TRUE(enu.ToGeodetic({&p, 1}).ok());
    EXPECT_TRUE(grid.FromGeodetic({&p, 1}).ok());
    return p;
  };
  for (BlockImage& image : truth.images) {
    // Forward differences from space to the grid: apart from the reader's, which go from the grid to space.
    Eigen::Matrix3d jacobian;
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d step = 5 * Eigen::Vector3d::Unit(k);
      jacobian.col(k) = to_grid(image.centre + step) - to_grid(image.centre - step);
    }
    const Eigen::Matrix3d grid_from_enu = Eigen::AngleAxisd(Eigen::Affine3d(jacobian).rotation()).toRotationMatrix();
    image.rotation_cam_from_block *= grid_from_enu.transpose();
    image.centre = to_grid(image.centre);
  }
  for (BlockTiePoint& point : truth.points) point.position = to_grid(point.position);
  truth.crs = crs;
  return truth;
}

TEST(FramesTest, TrueFrameByTheTextbook) {
  const SceneMap map = MapAt("EPSG:4979", FrameChoice::kTrue, {2.35, 48.86, 130});
  ASSERT_EQ(map.scene().kind, Crs::Kind::kEnu);
  EXPECT_EQ(map.scene().lat_rad, 48.86 * kFramesDegree);
  EXPECT_EQ(map.scene().lon_rad, 2.35 * kFramesDegree);
  EXPECT_EQ(map.scene().height_m, 0);
  const Eigen::Matrix3d enu = EnuFromGeocentric(48.86 * kFramesDegree, 2.35 * kFramesDegree);
  const Eigen::Vector3d origin = Geocentric(48.86 * kFramesDegree, 2.35 * kFramesDegree, 0);
  for (const Eigen::Vector3d& p : {Eigen::Vector3d(2.35, 48.86, 130), {2.36, 48.85, 20}, {2.30, 48.90, 700}}) {
    const Eigen::Vector3d ecef = Geocentric(p.y() * kFramesDegree, p.x() * kFramesDegree, p.z());
    EXPECT_LT((InScene(map, p) - enu * (ecef - origin)).norm(), 1e-6);
    // Directions at the point: its own east, north and up.
    const Eigen::Matrix3d own = EnuFromGeocentric(p.y() * kFramesDegree, p.x() * kFramesDegree);
    const StatusOr<Eigen::Matrix3d> rotation = map.SceneFromSourceRotation(p);
    ASSERT_TRUE(rotation.ok()) << rotation.status();
    EXPECT_LT((*rotation - enu * own.transpose()).norm(), 1e-8);
  }
}

TEST(FramesTest, GeocentricAxesTurnAsOne) {
  const Eigen::Vector3d near = Geocentric(48.86 * kFramesDegree, 2.35 * kFramesDegree, 130);
  const SceneMap map = MapAt("EPSG:4978", FrameChoice::kGrid, near);  // there is no grid: the true frame
  ASSERT_EQ(map.scene().kind, Crs::Kind::kEnu);
  const Eigen::Matrix3d enu = EnuFromGeocentric(48.86 * kFramesDegree, 2.35 * kFramesDegree);
  EXPECT_LT((*map.SceneFromSourceRotation(near) - enu).norm(), 1e-7);
  EXPECT_LT((InScene(map, near) - Eigen::Vector3d(0, 0, 130)).norm(), 1e-5);
}

// The convergence of UTM at ODM's block: ODM states the turn between its two reconstructions, -0.4965 degrees.
TEST(FramesTest, ConvergenceIsInTheRotation) {
  const Eigen::Vector3d near(437036, 4572789, 340);
  const SceneMap map = MapAt("EPSG:32617", FrameChoice::kTrue, near);
  const Eigen::Matrix3d rotation = *map.SceneFromSourceRotation(near);
  EXPECT_NEAR(std::atan2(rotation(0, 1), rotation(1, 1)) / kFramesDegree, -0.4965, 1e-4);  // of grid north
  EXPECT_LT((rotation.col(2) - Eigen::Vector3d::UnitZ()).norm(), 1e-6);
  EXPECT_LT((rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).norm(), 1e-12);
  EXPECT_GT(rotation.determinant(), 0);
  // The scale of the grid, which the true frame does not have: 0.9996 (1 + x^2 / (2 R^2)) at 63 km.
  const double length = (InScene(map, near + Eigen::Vector3d(0, 100, 0)) - InScene(map, near)).norm();
  EXPECT_NEAR(100 / length, 0.9996 * (1 + 62964.0 * 62964 / (2 * 6.378e6 * 6.378e6)) / (1 + 340 / 6.37e6), 2e-6);
}

TEST(FramesTest, GridKeepsCoordinates) {
  const Eigen::Vector3d offset(652000, 6863000, 100);
  const SceneMap lambert = MapAt("EPSG:2154+5720", FrameChoice::kGrid, {10, 20, 30}, offset);
  Crs expected;
  expected.kind = Crs::Kind::kProjected;
  expected.epsg = 2154;
  expected.vertical_epsg = 5720;
  EXPECT_EQ(lambert.scene(), expected);
  EXPECT_TRUE(lambert.keeps_coordinates());
  EXPECT_EQ(InScene(lambert, {10, 20, 30}), offset + Eigen::Vector3d(10, 20, 30));
  EXPECT_EQ(*lambert.SceneFromSourceRotation({10, 20, 30}), Eigen::Matrix3d::Identity());
  EXPECT_EQ(MapAt("EPSG:32632", FrameChoice::kGrid, {500000, 5300000, 1}).scene().kind, Crs::Kind::kUtm);
  // Feet become metres.
  const SceneMap feet = MapAt("EPSG:2263", FrameChoice::kGrid, {1000000, 200000, 100});
  EXPECT_LT((InScene(feet, {1000000, 200000, 100}) - Eigen::Vector3d(1000000, 200000, 100) * (1200.0 / 3937)).norm(),
            1e-6);
}

TEST(FramesTest, LocalAndEastNorthUpStayAsTheyAre) {
  for (const FrameChoice choice : {FrameChoice::kGrid, FrameChoice::kTrue}) {
    const SceneMap local = MapAt("", choice, {1, 2, 3}, {100, 0, 0});
    EXPECT_EQ(local.scene(), Crs());
    EXPECT_EQ(InScene(local, {1, 2, 3}), Eigen::Vector3d(101, 2, 3));
    const SceneMap enu = MapAt("ENU:39.97523,-83.00678", choice, {29, 4, 127});
    EXPECT_EQ(enu.scene().kind, Crs::Kind::kEnu);
    EXPECT_EQ(enu.scene().lat_rad, 39.97523 * kFramesDegree);
    EXPECT_EQ(InScene(enu, {29, 4, 127}), Eigen::Vector3d(29, 4, 127));
  }
}

TEST(FramesTest, OutAndInAgain) {
  const std::pair<const char*, Eigen::Vector3d> sources[] = {
      {"EPSG:2154+5720", {652000, 6863073, 130}}, {"EPSG:28992+5709", {155000, 463000, 10}},
      {"EPSG:27700", {651409, 313177, 60}},       {"EPSG:32632+5773", {690123, 5350321, 520}},
      {"EPSG:2263", {1000000, 200000, 300}},      {"EPSG:4978", {4201000, 172460, 4780100}}};
  for (const auto& [crs, near] : sources) {
    for (const FrameChoice choice : {FrameChoice::kGrid, FrameChoice::kTrue}) {
      const SceneMap map = MapAt(crs, choice, {0, 0, 0}, near);
      std::vector<Eigen::Vector3d> points;
      for (int k = 0; k < 27; ++k) points.push_back({1500.0 * (k % 3 - 1), 1500.0 * (k / 3 % 3 - 1), 90.0 * (k / 9)});
      std::vector<Eigen::Vector3d> moved = points;
      ASSERT_TRUE(map.SceneFromSource(moved).ok()) << crs;
      ASSERT_TRUE(map.SourceFromScene(moved).ok()) << crs;
      for (size_t k = 0; k < points.size(); ++k) EXPECT_LT((moved[k] - points[k]).norm(), 1e-6) << crs;
    }
  }
}

TEST(FramesTest, ProgramsThatAdjustInSpaceNeedTheTrueFrame) {
  const ImportedBlock truth = BlockAt("", {300, -200, 60});
  const Eigen::Vector3d near(652310, 6862420, 80);
  const ImportedBlock written = WrittenInGrid(truth, "EPSG:2154", near);
  Warnings warnings;
  const StatusOr<PlacedBlock> placed = PlaceBlock(written, FrameChoice::kTrue, {}, &warnings);
  ASSERT_TRUE(placed.ok()) << placed.status();
  EXPECT_TRUE(placed->true_frame);
  EXPECT_LT(LargestError_px(placed->block), 1e-3);
  EXPECT_TRUE(placed->block.crs.empty());
  // The placed block is the truth, moved as a rigid body: distances are those of the truth.
  for (size_t k = 1; k < truth.images.size(); ++k) {
    EXPECT_NEAR((placed->block.images[k].centre - placed->block.images[0].centre).norm(),
                (truth.images[k].centre - truth.images[0].centre).norm(), 1e-5);
  }
  const StatusOr<PlacedBlock> kept = PlaceBlock(written, FrameChoice::kGrid, {}, &warnings);
  ASSERT_TRUE(kept.ok());
  EXPECT_FALSE(kept->true_frame);
  EXPECT_GT(LargestError_px(kept->block), 0.05);
  EXPECT_EQ(kept->block.images[3].centre, written.images[3].centre);
  EXPECT_EQ(kept->block.images[3].rotation_cam_from_block, written.images[3].rotation_cam_from_block);
}

TEST(FramesTest, ProgramsThatAdjustInTheGridNeedTheGrid) {
  ImportedBlock block = BlockAt("EPSG:32632", {690000, 5350000, 500});
  block.control_points.push_back(block.points[0]);
  Warnings warnings;
  const StatusOr<PlacedBlock> kept = PlaceBlock(block, FrameChoice::kGrid, {}, &warnings);
  ASSERT_TRUE(kept.ok()) << kept.status();
  EXPECT_LT(LargestError_px(kept->block), 1e-5);
  const StatusOr<PlacedBlock> turned = PlaceBlock(block, FrameChoice::kTrue, {}, &warnings);
  ASSERT_TRUE(turned.ok());
  EXPECT_GT(LargestError_px(turned->block), 0.05);
  EXPECT_LT(LargestError_px(turned->block), 2);
  EXPECT_EQ(turned->block.control_points[0].position, turned->block.points[0].position);
}

// They are triangulated in the scene.
TEST(FramesTest, TiePointsWithoutPositionStayWithoutOne) {
  ImportedBlock block = BlockAt("EPSG:32632", {690000, 5350000, 500});
  const Eigen::Vector3d position = block.points[2].position;
  block.points[2].position.setZero();
  Warnings warnings;
  StatusOr<PlacedBlock> placed = PlaceBlock(block, FrameChoice::kTrue, {}, &warnings);
  ASSERT_TRUE(placed.ok()) << placed.status();
  EXPECT_EQ(placed->block.points[2].position, Eigen::Vector3d::Zero());
  EXPECT_LT((placed->block.points[3].position - InScene(placed->map, block.points[3].position)).norm(), 1e-9);
  const Proof proof = MeasureProof(&placed->block, {});
  EXPECT_EQ(proof.triangulated, 1);
  EXPECT_LT((placed->block.points[2].position - InScene(placed->map, position)).norm(), 0.5);
}

TEST(FramesTest, MeshesOfAnotherSystemAndOffset) {
  Warnings warnings;
  const ImportedBlock block = BlockAt("EPSG:32631", {452000, 5412000, 100});
  for (const FrameChoice choice : {FrameChoice::kGrid, FrameChoice::kTrue}) {
    const StatusOr<PlacedBlock> placed = PlaceBlock(block, choice, {}, &warnings);
    ASSERT_TRUE(placed.ok()) << placed.status();
    const Eigen::Vector3d in_block(452100, 5412050, 110);
    const Eigen::Vector3d expected = InScene(placed->map, in_block);
    const Eigen::Vector3d offset(452000, 5412000, 0);
    const StatusOr<SceneMap> same = SceneMap::Open({"EPSG:32631", offset}, placed->map.scene(), {}, {0, 0, 0});
    ASSERT_TRUE(same.ok()) << same.status();
    EXPECT_LT((InScene(*same, in_block - offset) - expected).norm(), 1e-6);
    EXPECT_EQ(same->keeps_coordinates(), choice == FrameChoice::kGrid);
    // The point in longitude and latitude.
    ReferenceSystem utm = *ReferenceSystem::Parse("EPSG:32631");
    Eigen::Vector3d g = in_block;
    ASSERT_TRUE(utm.Locate(g).ok() && utm.ToGeodetic({&g, 1}).ok());
    const Eigen::Vector3d angles(g.y() / kFramesDegree, g.x() / kFramesDegree, g.z());
    const StatusOr<SceneMap> other =
        SceneMap::Open({"EPSG:4979", Eigen::Vector3d::Zero()}, placed->map.scene(), {}, angles);
    ASSERT_TRUE(other.ok()) << other.status();
    EXPECT_LT((InScene(*other, angles) - expected).norm(), 1e-6);
    EXPECT_FALSE(SceneMap::Open({"", Eigen::Vector3d::Zero()}, placed->map.scene(), {}, {0, 0, 0}).ok());
  }
}

TEST(FramesTest, OptionsOverrideTheSource) {
  const ImportedBlock block = BlockAt("EPSG:32632", {652000, 6863000, 100});
  Warnings warnings;
  const StatusOr<PlacedBlock> placed =
      PlaceBlock(block, FrameChoice::kGrid, {.crs = "EPSG:2154", .heights = {}}, &warnings);
  ASSERT_TRUE(placed.ok()) << placed.status();
  EXPECT_EQ(placed->map.scene().epsg, 2154);
  EXPECT_THAT(warnings,
              testing::Contains(HasSubstr("the source's coordinate system is EPSG:32632; EPSG:2154 is used")));
  const StatusOr<PlacedBlock> local = PlaceBlock(block, FrameChoice::kTrue, {.crs = "local", .heights = {}}, &warnings);
  ASSERT_TRUE(local.ok());
  EXPECT_EQ(local->block.images[0].centre, block.images[0].centre);
  HeightOptions heights;
  heights.geoid_height_m = 44;
  const StatusOr<PlacedBlock> raised =
      PlaceBlock(block, FrameChoice::kGrid, {.crs = "EPSG:2154+5720", .heights = heights}, &warnings);
  ASSERT_TRUE(raised.ok());
  EXPECT_EQ(raised->map.scene().height_m, 44);
}

TEST(FramesTest, RefusesWhatHasNoPlace) {
  Warnings warnings;
  EXPECT_THAT(
      std::string(PlaceBlock(BlockAt("EPSG:999999", {0, 0, 0}), FrameChoice::kTrue, {}, &warnings).status().message()),
      HasSubstr("EPSG:999999"));
  // No EPSG code: the grid has no name in scene.json.
  const char own[] = "+proj=tmerc +lat_0=48.1 +lon_0=2.2 +k=1 +x_0=1000 +y_0=1000 +datum=WGS84";
  const ImportedBlock block = BlockAt(own, {1500, 2500, 100});
  EXPECT_THAT(std::string(PlaceBlock(block, FrameChoice::kGrid, {}, &warnings).status().message()),
              HasSubstr("has no EPSG code"));
  EXPECT_TRUE(PlaceBlock(block, FrameChoice::kTrue, {}, &warnings).ok());
  // Left-handed axes.
  EXPECT_THAT(std::string(PlaceBlock(BlockAt("+proj=utm +zone=31 +datum=WGS84 +axis=wnu", {-500000, 5412000, 100}),
                                     FrameChoice::kTrue, {}, &warnings)
                              .status()
                              .message()),
              HasSubstr("left-handed"));
}

}  // namespace
}  // namespace tessera
