// The layout of the procedural city: streets, blocks, buildings, trees and terrain.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <utility>
#include <vector>

namespace tessera {

// Class indices of a synthetic scene, the default classes of scene.json in their order.
enum CityClass : int32_t { kGround = 0, kFacade = 1, kRoof = 2, kVegetation = 3 };
inline constexpr int kCityClasses = 4;

struct CityChanges;

// City frame: metres, z up, centre of the city at x = y = 0. Blocks lie on a square lattice of pitch kPitch; the square
// of a block includes half of the adjacent streets. Everything is a function of seed and position, so any part of the
// city can be generated alone.
struct CityPlan {
  int columns = 1;
  int rows = 1;
  uint64_t seed = 0;
  double gsd_m = 0.12;
  std::shared_ptr<const CityChanges> changes = nullptr;  // of a second epoch; null: none

  static constexpr double kPitch = 44.0;      // distance of blocks, metres
  static constexpr double kHalfStreet = 5.0;  // from the border of a block's square to its kerb
  static constexpr double kSidewalk = 2.0;    // behind the kerb
  static constexpr double kKerbHeight = 0.15;
  static constexpr double kKerbWidth = 0.04;
  static constexpr double kApron = 8.0;  // width of open land around the outermost streets

  double MinX() const { return -0.5 * columns * kPitch; }
  double MinY() const { return -0.5 * rows * kPitch; }
  double MaxX() const { return -MinX(); }
  double MaxY() const { return -MinY(); }
  // Lower corner of a block's square.
  Eigen::Vector2d BlockOrigin(int column, int row) const { return {MinX() + column * kPitch, MinY() + row * kPitch}; }
  // Column and row of the block whose square contains the point, or of the nearest one.
  std::pair<int, int> BlockAt(const Eigen::Vector2d& p) const {
    const auto at = [](double offset, int count) {
      return std::clamp(static_cast<int>(std::floor(offset / kPitch)), 0, count - 1);
    };
    return {at(p.x() - MinX(), columns), at(p.y() - MinY(), rows)};
  }
  int Blocks() const { return columns * rows; }
};

// Whether (x, y) lies behind a kerb (on a block or on the land around the city), not on a street.
bool IsRaised(const CityPlan& plan, double x, double y);

// Height of the ground without kerbs in metres: long slopes, hills and fine roughness.
double TerrainHeight(const CityPlan& plan, double x, double y);

// Height of the ground with its kerbs.
double GroundHeight(const CityPlan& plan, double x, double y);

enum class RoofKind { kFlat, kGabled, kHipped };
enum class WallKind { kPlaster, kBrick, kConcrete, kPlain };

// A building with a rectangular footprint. Building frame: origin in the centre of the footprint at z = floor_z_m, x
// along the width (and the ridge), rotated by yaw_rad relative to the city frame.
struct BuildingSpec {
  Eigen::Vector2d centre;
  double yaw_rad = 0;
  double width_m = 10, depth_m = 8;
  double floor_z_m = 0;  // height of the ground floor, city frame
  double foot_z_m = 0;   // lower end of the walls, below the lowest ground around the building
  int floors = 2;
  double floor_height_m = 3;
  RoofKind roof = RoofKind::kGabled;
  WallKind wall = WallKind::kPlaster;
  double reveal_m = 0.2;  // depth of window reveals
  double roof_pitch_rad = 0.6;
  bool balconies = false;
  bool pilasters = false;
  int dormers = 0;  // per side
  int chimneys = 0;
  bool planted = false;  // the deck of a flat roof is vegetation
  uint64_t seed = 0;
};

// Sets floor_z_m and foot_z_m from the ground around the building.
void PlaceOnGround(const CityPlan& plan, BuildingSpec& building);

struct TreeSpec {
  Eigen::Vector3d foot;     // position on the ground
  Eigen::Vector3d radii_m;  // radii of the crown
  double crown_z_m = 3;     // height of the crown's centre above the foot
  uint32_t seed = 0;
};

struct BlockPlan {
  std::vector<BuildingSpec> buildings;
  std::vector<TreeSpec> trees;
  double paved_share = 0.3;  // share of the block's interior that is paved; the rest is green
};

// The layout of a block: that of the plan's changes if they contain the block, else that of the seed.
BlockPlan PlanBlock(const CityPlan& plan, int column, int row);

// Ground that is vegetation in a second epoch. Its sides lie on lines of the ground grid.
struct Planting {
  Eigen::AlignedBox2d area;
  uint32_t seed = 0;  // for its texture
};

// Differences from the city of the seed. All other blocks and ground are bit-identical to it.
struct CityChanges {
  std::map<std::pair<int, int>, BlockPlan> blocks;  // by column and row: the new layout of the whole block
  std::vector<Planting> plantings;
};

// The planting that contains (x, y); null: none.
const Planting* PlantingAt(const CityPlan& plan, double x, double y);

}  // namespace tessera
