#include "common/synth/city/plan.h"

#include <algorithm>
#include <cmath>

#include "common/base/random.h"
#include "common/synth/noise.h"

namespace tessera {
namespace {

constexpr double kTwoPi = 6.283185307179586;
// The range of a block's square that may be built on: behind the pavement.
constexpr double kLotMin = CityPlan::kHalfStreet + CityPlan::kSidewalk + 0.5;
constexpr double kLotMax = CityPlan::kPitch - kLotMin;

enum class BlockKind { kHouses, kRows, kSlabs, kTower, kPark };

BlockKind KindOfBlock(const CityPlan& plan, int column, int row) {
  static constexpr BlockKind kCycle[] = {BlockKind::kHouses, BlockKind::kSlabs, BlockKind::kRows,  BlockKind::kTower,
                                         BlockKind::kHouses, BlockKind::kRows,  BlockKind::kSlabs, BlockKind::kPark};
  const uint64_t start = MixBits(plan.seed ^ 0x626c6f636b73ull);
  if (plan.Blocks() == 1) return start & 1 ? BlockKind::kHouses : BlockKind::kRows;
  // Neighbouring blocks differ, and any 2 x 2 blocks contain four kinds, for every seed.
  if (plan.Blocks() <= 4) return kCycle[(start + column + 2 * row) % 4];
  return kCycle[(start + column + 3 * row) % 8];
}

class BlockPlanner {
 public:
  BlockPlanner(const CityPlan& plan, int column, int row)
      : plan_(plan),
        random_(MixBits(plan.seed) ^ MixBits((static_cast<uint64_t>(column) << 32) + row)),
        origin_(plan.BlockOrigin(column, row)),
        turned_(random_.Uniform() < 0.5),
        kind_(KindOfBlock(plan, column, row)) {
    yaw_ = random_.Uniform(-0.07, 0.07);
    first_roof_ = static_cast<int>(random_.Below(3));
  }

  BlockPlan Run() {
    switch (kind_) {
      case BlockKind::kHouses:
        Houses();
        break;
      case BlockKind::kRows:
        Rows();
        break;
      case BlockKind::kSlabs:
        Slabs();
        break;
      case BlockKind::kTower:
        Tower();
        break;
      case BlockKind::kPark:
        Park();
        break;
    }
    StreetTrees();
    return std::move(block_);
  }

 private:
  // Adds a building centred at (x, y) of the block's square, with its ridge along x (along y in rotated blocks).
  BuildingSpec& Building(double x, double y, double width, double depth, int floors, RoofKind roof) {
    BuildingSpec b;
    const double turn = std::cos(yaw_), side = std::sin(yaw_), half = 0.5 * CityPlan::kPitch;
    Eigen::Vector2d p(half + turn * (x - half) - side * (y - half), half + side * (x - half) + turn * (y - half));
    b.yaw_rad = yaw_ + random_.Uniform(-0.015, 0.015);
    if (turned_) {
      p = Eigen::Vector2d(CityPlan::kPitch - p.y(), p.x());
      b.yaw_rad += kTwoPi / 4;
    }
    b.centre = origin_ + p;
    b.width_m = width;
    b.depth_m = depth;
    b.floors = floors;
    b.floor_height_m = random_.Uniform(2.8, 3.3);
    b.roof = roof;
    b.seed = random_.Bits();
    const double pick = random_.Uniform();
    b.wall = pick < 0.38   ? WallKind::kPlaster
             : pick < 0.7  ? WallKind::kBrick
             : pick < 0.88 ? WallKind::kConcrete
                           : WallKind::kPlain;
    b.reveal_m = random_.Uniform(0.1, 0.4);
    b.roof_pitch_rad = random_.Uniform(0.55, 0.8);
    b.pilasters = random_.Uniform() < 0.3;
    b.balconies = floors >= 3 ? random_.Uniform() < 0.8 : random_.Uniform() < 0.3;
    if (roof != RoofKind::kFlat) {
      b.chimneys = 1 + static_cast<int>(random_.Below(2));
      const int fit = static_cast<int>((width - 3) / 3.2);
      b.dormers = depth < 6.5 ? 0 : std::min<int>(fit, static_cast<int>(random_.Below(4)));
    }
    PlaceOnGround(plan_, b);
    block_.buildings.push_back(b);
    return block_.buildings.back();
  }

  RoofKind NextRoof() { return static_cast<RoofKind>((first_roof_ + roofs_++) % 3); }
  RoofKind NextSteepRoof() { return roofs_++ % 2 ? RoofKind::kHipped : RoofKind::kGabled; }

  void Tree(double x, double y, double size) {
    if (turned_) {
      const double old_x = x;
      x = CityPlan::kPitch - y;
      y = old_x;
    }
    TreeSpec t;
    size *= 1.55;  // crowns of 2.5 to 7 m across
    const Eigen::Vector2d p = origin_ + Eigen::Vector2d(x, y);
    t.foot = {p.x(), p.y(), GroundHeight(plan_, p.x(), p.y())};
    t.radii_m =
        size * Eigen::Vector3d(random_.Uniform(0.85, 1.1), random_.Uniform(0.85, 1.1), random_.Uniform(0.9, 1.4));
    t.crown_z_m = t.radii_m.z() + random_.Uniform(0.1, 0.5) * size;
    t.seed = static_cast<uint32_t>(random_.Bits());
    block_.trees.push_back(t);
  }

  void Houses() {
    block_.paved_share = 0.2;
    for (int k = 0; k < 4; ++k) {
      const double x = k % 2 ? kLotMax - 6.3 : kLotMin + 6.3, y = k / 2 ? kLotMax - 5.6 : kLotMin + 5.6;
      Building(x + random_.Uniform(-0.5, 0.5), y + random_.Uniform(-0.5, 0.5), random_.Uniform(8.5, 10.5),
               random_.Uniform(7, 8.5), random_.Uniform() < 0.6 ? 2 : 1, k == 2 ? RoofKind::kFlat : NextSteepRoof());
    }
    for (int k = 0; k < 5; ++k) {
      Tree(0.5 * CityPlan::kPitch + random_.Uniform(-1, 1), kLotMin + 2 + k * 6.2 + random_.Uniform(-1, 1),
           random_.Uniform(0.9, 1.9));
    }
    Tree(kLotMin + 4, 0.5 * CityPlan::kPitch, random_.Uniform(0.7, 1.3));
    Tree(kLotMax - 4, 0.5 * CityPlan::kPitch, random_.Uniform(0.7, 1.3));
  }

  void Rows() {
    block_.paved_share = 0.3;
    for (int side = 0; side < 2; ++side) {
      const int houses = 3 + static_cast<int>(random_.Below(2));
      const double width = (kLotMax - kLotMin - 1.5) / houses;
      const bool alike = random_.Uniform() < 0.5;
      const RoofKind roof = side ? RoofKind::kGabled : NextRoof();
      const int floors = 2 + static_cast<int>(random_.Below(2));
      for (int k = 0; k < houses; ++k) {
        const double depth = 9 + random_.Uniform(-0.4, 0.4);
        const double y = side ? kLotMax - 5 : kLotMin + 5;
        // A terrace is a flush row, or stepped in height and depth; adjacent walls overlap slightly.
        Building(kLotMin + 0.75 + (k + 0.5) * width, y + (alike ? 0 : random_.Uniform(-0.6, 0.6)),
                 width - (alike ? 0.1 : 0.3), depth, alike ? floors : 2 + static_cast<int>(random_.Below(2)),
                 alike ? roof : NextRoof());
      }
    }
    for (int k = 0; k < 4; ++k) {
      Tree(kLotMin + 3.5 + k * 7.3 + random_.Uniform(-1, 1), 0.5 * CityPlan::kPitch + random_.Uniform(-1.3, 1.3),
           random_.Uniform(0.9, 1.8));
    }
  }

  void Slabs() {
    block_.paved_share = 0.6;
    Building(0.5 * CityPlan::kPitch, kLotMin + 5.6, random_.Uniform(25, 27), random_.Uniform(9.5, 10.5),
             3 + static_cast<int>(random_.Below(3)), RoofKind::kFlat)
        .balconies = true;
    Building(0.5 * CityPlan::kPitch - 2, kLotMax - 5, random_.Uniform(20, 22), random_.Uniform(8, 9),
             3 + static_cast<int>(random_.Below(2)), NextSteepRoof())
        .dormers = 3;
    for (int k = 0; k < 4; ++k) {
      Tree(kLotMin + 3 + k * 7.5 + random_.Uniform(-1, 1), 0.5 * CityPlan::kPitch + 1 + random_.Uniform(-1, 1),
           random_.Uniform(0.9, 1.7));
    }
  }

  void Tower() {
    block_.paved_share = 0.5;
    Building(kLotMin + 8, kLotMin + 8, random_.Uniform(12, 13.5), random_.Uniform(12, 13.5),
             5 + static_cast<int>(random_.Below(3)), RoofKind::kFlat)
        .balconies = true;
    Building(kLotMax - 6, 0.5 * CityPlan::kPitch + 2, random_.Uniform(8.5, 9.5), random_.Uniform(17, 20),
             1 + static_cast<int>(random_.Below(2)), random_.Uniform() < 0.5 ? RoofKind::kFlat : RoofKind::kHipped);
    for (int k = 0; k < 7; ++k) {
      Tree(kLotMin + 1.5 + (k % 3) * 5 + random_.Uniform(-1, 1), kLotMax - 2.5 - (k / 3) * 5 + random_.Uniform(-1, 1),
           random_.Uniform(0.8, 2.0));
    }
  }

  void Park() {
    block_.paved_share = 0.15;
    Building(kLotMin + 6, kLotMax - 5, 7.5, 6, 1, RoofKind::kHipped);
    for (int k = 0; k < 14; ++k) {
      Tree(random_.Uniform(kLotMin + 1, kLotMax - 1), random_.Uniform(kLotMin + 1, kLotMax - 11),
           random_.Uniform(0.7, 2.4));
    }
  }

  void StreetTrees() {
    const double kerb = CityPlan::kHalfStreet + 0.9;
    for (int side = 0; side < 4; ++side) {
      if (random_.Uniform() < 0.55) continue;
      for (double along = 8; along < CityPlan::kPitch - 7; along += 13) {
        const double a = along + random_.Uniform(-1, 1), b = side % 2 ? CityPlan::kPitch - kerb : kerb;
        Tree(side < 2 ? a : b, side < 2 ? b : a, random_.Uniform(0.8, 1.3));
      }
    }
  }

  const CityPlan& plan_;
  Random random_;
  Eigen::Vector2d origin_;
  bool turned_;
  BlockKind kind_;
  double yaw_ = 0;
  int first_roof_ = 0;
  int roofs_ = 0;
  BlockPlan block_;
};

// Position within a block's square, for coordinates inside the city.
double WithinBlock(double offset) { return offset - CityPlan::kPitch * std::floor(offset / CityPlan::kPitch); }

}  // namespace

bool IsRaised(const CityPlan& plan, double x, double y) {
  if (x < plan.MinX() - 1e-9 || x > plan.MaxX() + 1e-9 || y < plan.MinY() - 1e-9 || y > plan.MaxY() + 1e-9) return true;
  const double u = WithinBlock(x - plan.MinX()), v = WithinBlock(y - plan.MinY());
  const double low = CityPlan::kHalfStreet - 1e-9, high = CityPlan::kPitch - CityPlan::kHalfStreet + 1e-9;
  return u >= low && u <= high && v >= low && v <= high;
}

double TerrainHeight(const CityPlan& plan, double x, double y) {
  const uint32_t seed = static_cast<uint32_t>(MixBits(plan.seed ^ 0x7465727261696eull));
  const double phase = LatticeUniform(1, 0, 0, seed) * kTwoPi, heading = LatticeUniform(2, 0, 0, seed) * kTwoPi;
  const double along = x * std::cos(heading) + y * std::sin(heading);
  return 5.0 * std::sin(along * kTwoPi / 640.0 + phase) + 1.6 * ValueNoise2(x / 55.0, y / 55.0, seed + 1) +
         0.35 * ValueNoise2(x / 14.0, y / 14.0, seed + 2) + 0.05 * ValueNoise2(x / 3.1, y / 3.1, seed + 3);
}

double GroundHeight(const CityPlan& plan, double x, double y) {
  return TerrainHeight(plan, x, y) + (IsRaised(plan, x, y) ? CityPlan::kKerbHeight : 0.0);
}

void PlaceOnGround(const CityPlan& plan, BuildingSpec& building) {
  double low = 1e9, sum = 0;
  const double reach = 0.5 * std::hypot(building.width_m, building.depth_m);
  for (int k = 0; k < 8; ++k) {
    const Eigen::Vector2d q =
        building.centre + reach * Eigen::Vector2d(std::cos(k * kTwoPi / 8), std::sin(k * kTwoPi / 8));
    const double z = GroundHeight(plan, q.x(), q.y());
    low = std::min(low, z);
    sum += z / 8;
  }
  building.floor_z_m = sum;
  building.foot_z_m = low - 1.5;
}

BlockPlan PlanBlock(const CityPlan& plan, int column, int row) {
  if (plan.changes != nullptr) {
    const auto changed = plan.changes->blocks.find({column, row});
    if (changed != plan.changes->blocks.end()) return changed->second;
  }
  return BlockPlanner(plan, column, row).Run();
}

const Planting* PlantingAt(const CityPlan& plan, double x, double y) {
  if (plan.changes == nullptr) return nullptr;
  for (const Planting& planting : plan.changes->plantings) {
    if (planting.area.contains(Eigen::Vector2d(x, y))) return &planting;
  }
  return nullptr;
}

}  // namespace tessera
