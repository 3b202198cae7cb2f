// The layout of the procedural city: streets, blocks, what stands in each block, and the lie of the land.
#ifndef TESSERA_COMMON_SYNTH_PLAN_H_
#define TESSERA_COMMON_SYNTH_PLAN_H_

#include <Eigen/Core>
#include <Eigen/Geometry>
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

// The city's frame: metres, z up, the middle of the city at x = y = 0. Blocks lie on a square lattice; each owns the
// square of kBlockPitch around it, half the streets included. Everything is a function of the seed and the place, so
// any part of the city can be made without the rest.
struct CityPlan {
  int columns = 1;
  int rows = 1;
  uint64_t seed = 0;
  double gsd_m = 0.12;
  std::shared_ptr<const CityChanges> changes;  // what a later epoch has otherwise; null: nothing

  static constexpr double kPitch = 44.0;      // metres from block to block
  static constexpr double kHalfStreet = 5.0;  // from the border of a block's square to its kerb
  static constexpr double kSidewalk = 2.0;    // behind the kerb
  static constexpr double kKerbHeight = 0.15;
  static constexpr double kKerbWidth = 0.04;
  static constexpr double kApron = 8.0;  // open land around the outermost streets

  double MinX() const { return -0.5 * columns * kPitch; }
  double MinY() const { return -0.5 * rows * kPitch; }
  double MaxX() const { return -MinX(); }
  double MaxY() const { return -MinY(); }
  // Lower corner of a block's square.
  Eigen::Vector2d BlockOrigin(int column, int row) const { return {MinX() + column * kPitch, MinY() + row * kPitch}; }
  int Blocks() const { return columns * rows; }
};

// Whether (x, y) lies behind a kerb (a block's ground or the land around the city) rather than on a street.
bool IsRaised(const CityPlan& plan, double x, double y);

// Height of the ground without kerbs: long slopes, knolls and fine unevenness, metres.
double TerrainHeight(const CityPlan& plan, double x, double y);

// Height of the ground with its kerbs.
double GroundHeight(const CityPlan& plan, double x, double y);

enum class RoofKind { kFlat, kGabled, kHipped };
enum class WallKind { kPlaster, kBrick, kConcrete, kPlain };

// A building of one rectangular storey stack. Its own frame: origin in the middle of the footprint at z = floor_z_m,
// x along the width (and the ridge), rotated by yaw_rad against the city's.
struct BuildingSpec {
  Eigen::Vector2d centre;
  double yaw_rad = 0;
  double width_m = 10, depth_m = 8;
  double floor_z_m = 0;  // ground floor above the city's zero
  double foot_z_m = 0;   // the walls' lower end, below the lowest ground around
  int floors = 2;
  double floor_height_m = 3;
  RoofKind roof = RoofKind::kGabled;
  WallKind wall = WallKind::kPlaster;
  double reveal_m = 0.2;  // depth of window reveals
  double roof_pitch_rad = 0.6;
  bool balconies = false;
  bool pilasters = false;
  int dormers = 0;  // a side
  int chimneys = 0;
  bool planted = false;  // a flat roof's deck is vegetation
  uint64_t seed = 0;
};

// Sets floor_z_m and foot_z_m from the ground around the building.
void SettleOnGround(const CityPlan& plan, BuildingSpec& building);

struct TreeSpec {
  Eigen::Vector3d foot;     // on the ground
  Eigen::Vector3d radii_m;  // of the crown
  double crown_z_m = 3;     // middle of the crown above the foot
  uint32_t seed = 0;
};

struct BlockPlan {
  std::vector<BuildingSpec> buildings;
  std::vector<TreeSpec> trees;
  double paved_share = 0.3;  // how much of the block's inside is paved rather than green
};

// The seed's layout, unless the plan's changes have another for this block.
BlockPlan PlanBlock(const CityPlan& plan, int column, int row);

// Ground that is vegetation in a later epoch. Its sides lie on lines of the ground's grid.
struct Planting {
  Eigen::AlignedBox2d area;
  uint32_t seed = 0;  // of its texture
};

// What differs from the city of the seed. Blocks and ground that are not named here are the seed's to the last bit.
struct CityChanges {
  std::map<std::pair<int, int>, BlockPlan> blocks;  // by column and row: the whole block as it is now
  std::vector<Planting> plantings;
};

// The planting that (x, y) lies in; null: none.
const Planting* PlantingAt(const CityPlan& plan, double x, double y);

}  // namespace tessera

#endif  // TESSERA_COMMON_SYNTH_PLAN_H_
