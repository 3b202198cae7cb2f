#include <algorithm>
#include <cmath>
#include <vector>

#include "common/base/random.h"
#include "common/synth/city/surface.h"

namespace tessera {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3d;
using Eigen::Vector3f;

// Vertical cuts of one facade, and the cells between them that are windows.
struct Bays {
  std::vector<double> cuts_m;     // from 0 to the facade's length
  std::vector<int> window_cells;  // cell k lies between cuts k and k + 1
};

Bays DivideFacade(double length, double bay, double window) {
  Bays bays;
  bays.cuts_m = {0};
  const int count = std::max(1, static_cast<int>(length / bay));
  const double step = length / count;
  for (int k = 0; k < count; ++k) {
    const double middle = (k + 0.5) * step, half = 0.5 * std::min(window, step - 0.6);
    bays.cuts_m.push_back(middle - half);
    bays.cuts_m.push_back(middle + half);
    bays.window_cells.push_back(2 * k + 1);
  }
  bays.cuts_m.push_back(length);
  return bays;
}

class BuildingBuilder {
 public:
  BuildingBuilder(const BuildingSpec& spec, BlockSolids& block)
      : spec_(spec),
        random_(spec.seed),
        builder_(block, {spec.centre.x(), spec.centre.y(), spec.floor_z_m}, spec.yaw_rad),
        x_(0.5 * spec.width_m),
        y_(0.5 * spec.depth_m),
        foot_(spec.foot_z_m - spec.floor_z_m),
        top_(0.4 + spec.floors * spec.floor_height_m) {
    static const Vector3f kPlaster[] = {
        {0.62f, 0.55f, 0.42f}, {0.6f, 0.58f, 0.54f}, {0.58f, 0.44f, 0.33f}, {0.48f, 0.52f, 0.5f}, {0.64f, 0.6f, 0.36f}};
    switch (spec.wall) {
      case WallKind::kPlaster:
        wall_ = {Material::kPlaster, kPlaster[random_.Below(5)], kFacade};
        break;
      case WallKind::kBrick:
        wall_ = {Material::kBrick, {0.36f, 0.17f, 0.11f}, kFacade};
        break;
      case WallKind::kConcrete:
        wall_ = {Material::kConcrete, {0.42f, 0.42f, 0.4f}, kFacade};
        break;
      case WallKind::kPlain:
        wall_ = {Material::kPlainWall, {0.62f, 0.62f, 0.6f}, kFacade};
        break;
    }
    wall_.albedo *= static_cast<float>(random_.Uniform(0.8, 1.1));
    trim_ = {Material::kConcrete, {0.55f, 0.54f, 0.5f}, kFacade};
    static const Vector3f kTileColors[] = {
        {0.36f, 0.13f, 0.08f}, {0.3f, 0.16f, 0.1f}, {0.16f, 0.16f, 0.18f}, {0.4f, 0.2f, 0.12f}};
    if (spec.roof == RoofKind::kFlat) {
      const double pick = random_.Uniform();
      roof_ = {pick < 0.6    ? Material::kRoofGravel
               : pick < 0.85 ? Material::kRoofMetal
                             : Material::kRoofPlain,
               {0.3f, 0.29f, 0.28f},
               kRoof};
    } else {
      roof_ = {random_.Uniform() < 0.85 ? Material::kRoofTiles : Material::kRoofMetal, kTileColors[random_.Below(4)],
               kRoof};
    }
  }

  void Run() {
    Body();
    Relief();
    switch (spec_.roof) {
      case RoofKind::kFlat:
        FlatRoof();
        break;
      case RoofKind::kGabled:
        GabledRoof();
        break;
      case RoofKind::kHipped:
        HippedRoof();
        break;
    }
  }

 private:
  uint32_t Seed() { return static_cast<uint32_t>(random_.Bits()); }

  // The walls: one closed prism with windows and doors recessed by the reveal.
  void Body() {
    builder_.Begin();
    std::vector<double> rows = {foot_};
    std::vector<int> window_rows;
    const double sill = random_.Uniform(0.8, 1.0), lintel = spec_.floor_height_m - 0.5;
    for (int floor = 0; floor < spec_.floors; ++floor) {
      const double base = 0.3 + floor * spec_.floor_height_m;
      rows.push_back(base + sill);
      window_rows.push_back(static_cast<int>(rows.size()) - 1);
      rows.push_back(base + lintel);
    }
    rows.push_back(top_);
    const double bay = random_.Uniform(2.3, 3.2), window = random_.Uniform(1.0, 1.5);
    const Vector3d corners[4] = {{-x_, -y_, 0}, {x_, -y_, 0}, {x_, y_, 0}, {-x_, y_, 0}};
    std::vector<Vector3d> rim;
    for (int side = 0; side < 4; ++side) {
      const Vector3d from = corners[side], to = corners[(side + 1) % 4];
      const Vector3d along = (to - from).normalized(), outward(along.y(), -along.x(), 0);
      const Bays bays = DivideFacade((to - from).norm(), bay, window);
      const uint32_t patch = builder_.Patch(wall_.material, Seed(), wall_.albedo, from, along, Vector3d::UnitZ());
      const auto at = [&](size_t column, size_t row, double inward) {
        return Vector3d(from + along * bays.cuts_m[column] + Vector3d(0, 0, rows[row]) - outward * inward);
      };
      for (size_t column = 0; column + 1 < bays.cuts_m.size(); ++column) {
        rim.push_back(at(column, rows.size() - 1, 0));
        const bool window_column =
            std::count(bays.window_cells.begin(), bays.window_cells.end(), static_cast<int>(column)) > 0;
        for (size_t row = 0; row + 1 < rows.size(); ++row) {
          const bool window_row = std::count(window_rows.begin(), window_rows.end(), static_cast<int>(row)) > 0;
          const bool set_back = window_column && window_row && random_.Uniform() < 0.92;
          const Vector3d a = at(column, row, 0), b = at(column + 1, row, 0), c = at(column + 1, row + 1, 0),
                         d = at(column, row + 1, 0);
          if (!set_back) {
            builder_.Quad(a, b, c, d, kFacade, patch);
            continue;
          }
          const double r = spec_.reveal_m;
          const Vector3d ia = at(column, row, r), ib = at(column + 1, row, r), ic = at(column + 1, row + 1, r),
                         id = at(column, row + 1, r);
          const Vector2f extent(static_cast<float>((b - a).norm()), static_cast<float>((d - a).norm()));
          const bool door = row == 1 && column == bays.cuts_m.size() / 2 && random_.Uniform() < 0.3;
          const uint32_t pane = builder_.Patch(door ? Material::kDoor : Material::kWindow, Seed(),
                                               {0.08f, 0.09f, 0.11f}, ia, along, Vector3d::UnitZ(), extent);
          const uint32_t flat = builder_.Patch(wall_.material, Seed(), wall_.albedo * 0.95f, a, along, outward);
          const uint32_t upright =
              builder_.Patch(wall_.material, Seed(), wall_.albedo * 0.95f, a, outward, Vector3d::UnitZ());
          builder_.Quad(ia, ib, ic, id, kFacade, pane);
          builder_.Quad(a, b, ib, ia, kFacade, flat);
          builder_.Quad(b, c, ic, ib, kFacade, upright);
          builder_.Quad(c, d, id, ic, kFacade, flat);
          builder_.Quad(d, a, ia, id, kFacade, upright);
          if (spec_.balconies && row > 1 && column % 4 == 1) balconies_.push_back({a, b, outward});
        }
      }
    }
    const bool planted = spec_.planted && spec_.roof == RoofKind::kFlat;
    const SurfacePatch plants = PlantingPatch(0, Vector3d::Zero());
    const uint32_t cap =
        builder_.Patch(planted ? plants.material : roof_.material, Seed(), planted ? plants.albedo : roof_.albedo,
                       {0, 0, top_}, Vector3d::UnitX(), Vector3d::UnitY());
    const int32_t deck = planted ? kVegetation : kRoof;
    const Vector3d top(0, 0, top_), bottom(0, 0, foot_);
    const auto lowered = [&](const Vector3d& p) { return Vector3d(p.x(), p.y(), foot_); };
    for (size_t k = 0; k < rim.size(); ++k) {
      const Vector3d &a = rim[k], &b = rim[(k + 1) % rim.size()];
      builder_.Triangle(top, a, b, deck, cap);
      builder_.Triangle(bottom, lowered(b), lowered(a), kFacade, cap);
    }
    builder_.Occupy({{{-x_, 0, 0}, -Vector3d::UnitX(), kFacade},
                     {{x_, 0, 0}, Vector3d::UnitX(), kFacade},
                     {{0, -y_, 0}, -Vector3d::UnitY(), kFacade},
                     {{0, y_, 0}, Vector3d::UnitY(), kFacade},
                     {top, Vector3d::UnitZ(), deck},
                     {bottom, -Vector3d::UnitZ(), kFacade}},
                    {{-x_, -y_, foot_}, {x_, -y_, foot_}, {-x_, y_, top_}, {x_, y_, top_}});
  }

  // Balconies, pilasters and a cornice, which protrude from the walls by 0.1 to 0.4 m.
  void Relief() {
    for (const Balcony& b : balconies_) {
      const double out = 0.4, side = 0.3;
      const Vector3d along = (b.right - b.left).normalized();
      const Vector3d p = b.left - along * side - b.outward * 0.1, q = b.right + along * side + b.outward * out;
      const double floor = b.left.z() - 1.0;
      builder_.Box({std::min(p.x(), q.x()), std::min(p.y(), q.y()), floor - 0.2},
                   {std::max(p.x(), q.x()), std::max(p.y(), q.y()), floor + 0.85}, trim_, trim_, Seed());
    }
    if (spec_.pilasters) {
      const double out = random_.Uniform(0.1, 0.25), half = 0.25;
      for (int side = 0; side < 2; ++side) {
        const double y = side ? y_ : -y_;
        for (int k = 0; k < 2; ++k) {
          const double x = k ? x_ - half : -x_ + half;
          builder_.Box({x - half, std::min(y, y + (side ? out : -out)) - (side ? 0.1 : 0), foot_},
                       {x + half, std::max(y, y + (side ? out : -out)) + (side ? 0 : 0.1), top_ - 0.4}, trim_, trim_,
                       Seed());
        }
      }
    }
    if (spec_.roof == RoofKind::kFlat) {
      const double out = random_.Uniform(0.1, 0.2);
      builder_.Box({-x_ - out, -y_ - out, top_ - 0.45}, {x_ + out, y_ + out, top_ - 0.1}, trim_,
                   {trim_.material, trim_.albedo, kFacade}, Seed());
    }
  }

  void FlatRoof() {
    const double high = top_ + random_.Uniform(0.4, 0.9), t = 0.3;
    const SolidBuilder::Finish coping = {Material::kRoofMetal, {0.4f, 0.4f, 0.42f}, kRoof};
    const double foot = top_ - 0.05;
    builder_.Box({-x_, -y_, foot}, {x_, -y_ + t, high}, wall_, coping, Seed());
    builder_.Box({-x_, y_ - t, foot}, {x_, y_, high}, wall_, coping, Seed());
    builder_.Box({-x_, -y_ + t - 0.02, foot}, {-x_ + t, y_ - t + 0.02, high}, wall_, coping, Seed());
    builder_.Box({x_ - t, -y_ + t - 0.02, foot}, {x_, y_ - t + 0.02, high}, wall_, coping, Seed());
    // A stairwell and technical equipment on the deck.
    const SolidBuilder::Finish plant = {Material::kConcrete, {0.45f, 0.45f, 0.43f}, kRoof};
    const int count = 1 + static_cast<int>(random_.Below(3));
    for (int k = 0; k < count; ++k) {
      const double w = random_.Uniform(0.8, k == 0 ? 2.0 : 1.3), d = random_.Uniform(0.8, 1.4),
                   h = random_.Uniform(0.7, k == 0 ? 2.4 : 1.2);
      const double x = -x_ + 1.5 + w + (2 * x_ - 3 - 2 * w) * (k + random_.Uniform(0.2, 0.8)) / count;
      const double y = random_.Uniform(-1, 1) * std::max(0.0, y_ - 1.2 - d);
      builder_.Box({x - w, y - d, top_ - 0.1}, {x + w, y + d, top_ + h}, plant, {roof_.material, roof_.albedo, kRoof},
                   Seed());
    }
  }

  // A gabled roof with its ridge along x: gable walls, and a slab with overhang.
  void GabledRoof() {
    const double rise = y_ * std::tan(spec_.roof_pitch_rad), slope = rise / y_, thick = 0.22;
    const double eaves = random_.Uniform(0.3, 0.5), verge = random_.Uniform(0.15, 0.4);
    builder_.Begin();
    {
      const uint32_t gable =
          builder_.Patch(wall_.material, Seed(), wall_.albedo, {-x_, -y_, top_}, Vector3d::UnitY(), Vector3d::UnitZ());
      const double z = top_ - 0.02;
      const Vector3d a(-x_, -y_, z), b(x_, -y_, z), c(x_, y_, z), d(-x_, y_, z), left(-x_, 0, z + rise),
          right(x_, 0, z + rise);
      builder_.Triangle(a, left, d, kFacade, gable);
      builder_.Triangle(b, c, right, kFacade, gable);
      builder_.Quad(a, b, right, left, kRoof, gable);
      builder_.Quad(c, d, left, right, kRoof, gable);
      builder_.Quad(a, d, c, b, kFacade, gable);
    }
    builder_.Begin();
    const double x = x_ + verge, y = y_ + eaves, low = top_ - eaves * slope, ridge = top_ + rise;
    const Vector3d front_up = Vector3d(0, 1, slope).normalized(), back_up = Vector3d(0, -1, slope).normalized();
    const uint32_t front =
        builder_.Patch(roof_.material, Seed(), roof_.albedo, {-x, -y, low}, Vector3d::UnitX(), front_up);
    const uint32_t back =
        builder_.Patch(roof_.material, Seed(), roof_.albedo, {x, y, low}, -Vector3d::UnitX(), back_up);
    const uint32_t edge = builder_.Patch(Material::kConcrete, Seed(), {0.4f, 0.38f, 0.35f}, {-x, -y, low},
                                         Vector3d::UnitY(), Vector3d::UnitZ());
    const Vector3d up(0, 0, thick);
    const auto p = [&](double sx, double sy) { return Vector3d(sx * x, sy * y, sy == 0 ? ridge : low); };
    builder_.Quad(p(-1, -1) + up, p(1, -1) + up, p(1, 0) + up, p(-1, 0) + up, kRoof, front);
    builder_.Quad(p(1, 1) + up, p(-1, 1) + up, p(-1, 0) + up, p(1, 0) + up, kRoof, back);
    builder_.Quad(p(-1, -1), p(-1, 0), p(1, 0), p(1, -1), kRoof, edge);
    builder_.Quad(p(-1, 0), p(-1, 1), p(1, 1), p(1, 0), kRoof, edge);
    builder_.Quad(p(-1, -1), p(1, -1), p(1, -1) + up, p(-1, -1) + up, kRoof, edge);
    builder_.Quad(p(1, 1), p(-1, 1), p(-1, 1) + up, p(1, 1) + up, kRoof, edge);
    for (int end = -1; end <= 1; end += 2) {
      for (int side = -1; side <= 1; side += 2) {
        const Vector3d a = p(end, side), b = p(end, 0);
        if (end * side > 0) {
          builder_.Quad(b, a, Vector3d(a + up), Vector3d(b + up), kRoof, edge);
        } else {
          builder_.Quad(a, b, Vector3d(b + up), Vector3d(a + up), kRoof, edge);
        }
      }
    }
    const Vector3d front_normal(0, -slope, 1), back_normal(0, slope, 1);
    builder_.Occupy({{p(-1, -1) + up, front_normal, kRoof},
                     {p(1, 1) + up, back_normal, kRoof},
                     {p(-1, 0), -Vector3d::UnitX(), kFacade},
                     {p(1, 0), Vector3d::UnitX(), kFacade},
                     {p(-1, -1), -Vector3d::UnitY(), kRoof},
                     {p(1, 1), Vector3d::UnitY(), kRoof},
                     {p(0, 1), -Vector3d::UnitZ(), kRoof}},
                    {p(-1, -1), p(1, -1), p(-1, 1), p(1, 1), p(-1, 0) + up, p(1, 0) + up});
    Dormers(low, slope, y);
    Chimneys(ridge + thick);
  }

  void HippedRoof() {
    const double eaves = random_.Uniform(0.3, 0.5), thick = 0.2;
    const double x = x_ + eaves, y = y_ + eaves, slope = std::tan(spec_.roof_pitch_rad);
    // The ridge is parallel to the longer side.
    const double hip = std::min(x, y), rise = hip * slope, low = top_ - 0.05, ridge = low + thick + rise;
    const double rx = std::max(0.15, x - hip), ry = std::max(0.15, y - hip);
    builder_.Begin();
    const Vector3d bottom[4] = {{-x, -y, low}, {x, -y, low}, {x, y, low}, {-x, y, low}};
    const Vector3d up(0, 0, thick);
    const bool along_x = x >= y;
    const Vector3d first = along_x ? Vector3d(-rx, 0, ridge) : Vector3d(0, -ry, ridge);
    const Vector3d second = along_x ? Vector3d(rx, 0, ridge) : Vector3d(0, ry, ridge);
    std::vector<SolidBuilder::LocalPlane> planes;
    const uint32_t edge = builder_.Patch(Material::kConcrete, Seed(), {0.4f, 0.38f, 0.35f}, {-x, -y, low},
                                         Vector3d::UnitX(), Vector3d::UnitZ());
    for (int side = 0; side < 4; ++side) {
      const Vector3d a = bottom[side], b = bottom[(side + 1) % 4], u = (b - a).normalized(), inward(-u.y(), u.x(), 0);
      builder_.Quad(a, b, b + up, a + up, kRoof, edge);
      planes.push_back({a, -inward, kRoof});
      const bool long_side = (side % 2 == 0) == along_x;
      // On a long side, the ends of the ridge above a and b; on a short side, the nearer end.
      const bool ordered = (second - first).dot(u) > 0;
      const Vector3d near_end = first.dot(-inward) > second.dot(-inward) ? first : second;
      const Vector3d crest = long_side ? (ordered ? first : second) : near_end;
      const Vector3d rise_axis = u.cross((b + up - (a + up)).cross(crest - (a + up))).normalized();
      const uint32_t patch = builder_.Patch(roof_.material, Seed(), roof_.albedo, a + up, u, -rise_axis);
      if (long_side) {
        builder_.Quad(a + up, b + up, ordered ? second : first, crest, kRoof, patch);
      } else {
        builder_.Triangle(a + up, b + up, crest, kRoof, patch);
      }
      planes.push_back({a + up, (b - a).cross(crest - a - up), kRoof});
    }
    builder_.Quad(bottom[0], bottom[3], bottom[2], bottom[1], kRoof, edge);
    planes.push_back({bottom[0], -Vector3d::UnitZ(), kRoof});
    builder_.Occupy(planes, {bottom[0], bottom[1], bottom[2], bottom[3], first, second});
    if (along_x) Dormers(low + thick, slope, y);
    Chimneys(ridge);
  }

  // Dormers on both long slopes: boxes with a gabled top, their fronts behind the eaves. `low`: height of the slope at
  // |y| = y_eaves.
  void Dormers(double low, double slope, double y_eaves) {
    if (spec_.dormers == 0) return;
    const double half = 0.75, front = y_ - 0.7, height = 1.55, peak = 0.5;
    const double base = low + (y_eaves - front) * slope;
    const double reach = spec_.roof == RoofKind::kHipped ? x_ - y_ - half + 1.2 : x_ - 1.5;
    if (reach < 0) return;
    for (int side = -1; side <= 1; side += 2) {
      for (int k = 0; k < spec_.dormers; ++k) {
        const double x = spec_.dormers == 1 ? 0 : -reach + 2 * reach * k / (spec_.dormers - 1);
        if (k > 0 && 2 * reach / (spec_.dormers - 1) < 2.2) break;
        // `right` is relative to a viewer in front of the dormer: +x for the side at -y.
        const Vector3d right(-side, 0, 0), inward(0, -side, 0), foot = Vector3d(x, side * front, base - 0.4);
        const double back = std::min(front, (height + peak + 0.6) / slope + 0.3);
        const auto p = [&](double r, double h, double in) {
          return Vector3d(foot + right * r + Vector3d(0, 0, h) + inward * in);
        };
        const double h = height + 0.4, top = h + peak;
        builder_.Begin();
        const uint32_t wall = builder_.Patch(wall_.material, Seed(), wall_.albedo, foot, inward, Vector3d::UnitZ());
        const uint32_t window =
            builder_.Patch(Material::kWindow, Seed(), {0.08f, 0.09f, 0.11f}, p(-half, 0.4, 0), right, Vector3d::UnitZ(),
                           {static_cast<float>(2 * half), static_cast<float>(height)});
        const uint32_t cover = builder_.Patch(roof_.material, Seed(), roof_.albedo, p(-half, h, 0), inward, right);
        builder_.Quad(p(-half, 0, 0), p(half, 0, 0), p(half, h, 0), p(-half, h, 0), kFacade, window);
        builder_.Triangle(p(-half, h, 0), p(half, h, 0), p(0, top, 0), kFacade, wall);
        builder_.Quad(p(half, 0, 0), p(half, 0, back), p(half, h, back), p(half, h, 0), kFacade, wall);
        builder_.Quad(p(-half, 0, back), p(-half, 0, 0), p(-half, h, 0), p(-half, h, back), kFacade, wall);
        builder_.Quad(p(half, h, 0), p(half, h, back), p(0, top, back), p(0, top, 0), kRoof, cover);
        builder_.Quad(p(-half, h, back), p(-half, h, 0), p(0, top, 0), p(0, top, back), kRoof, cover);
        builder_.Quad(p(half, 0, back), p(-half, 0, back), p(-half, h, back), p(half, h, back), kFacade, wall);
        builder_.Triangle(p(half, h, back), p(-half, h, back), p(0, top, back), kFacade, wall);
        builder_.Quad(p(-half, 0, back), p(half, 0, back), p(half, 0, 0), p(-half, 0, 0), kFacade, wall);
        builder_.Occupy({{p(0, 0, 0), -inward, kFacade},
                         {p(half, 0, 0), right, kFacade},
                         {p(-half, 0, 0), -right, kFacade},
                         {p(0, 0, back), inward, kFacade},
                         {p(0, 0, 0), -Vector3d::UnitZ(), kFacade},
                         {p(0, top, 0), Vector3d(right * peak + Vector3d(0, 0, half)), kRoof},
                         {p(0, top, 0), Vector3d(-right * peak + Vector3d(0, 0, half)), kRoof}},
                        {p(-half, 0, 0), p(half, 0, back), p(half, top, back), p(-half, top, 0)});
      }
    }
  }

  void Chimneys(double ridge) {
    for (int k = 0; k < spec_.chimneys; ++k) {
      const double half = random_.Uniform(0.25, 0.4), reach = std::max(0.0, x_ - y_ * 0.6);
      const double x = random_.Uniform(-reach, reach),
                   y = random_.Uniform(0.2, 0.8) * (random_.Uniform() < 0.5 ? -1 : 1);
      const SolidBuilder::Finish brick = {Material::kBrick, {0.34f, 0.17f, 0.12f}, kRoof};
      builder_.Box({x - half, y - half, ridge - 2.0}, {x + half, y + half, ridge + random_.Uniform(0.4, 1.0)}, brick,
                   brick, Seed());
    }
  }

  struct Balcony {
    Vector3d left, right, outward;  // lower corners of the window behind the balcony
  };

  const BuildingSpec& spec_;
  Random random_;
  SolidBuilder builder_;
  double x_, y_, foot_, top_;
  SolidBuilder::Finish wall_, trim_, roof_;
  std::vector<Balcony> balconies_;
};

}  // namespace

void BuildBuilding(const BuildingSpec& spec, BlockSolids& block) { BuildingBuilder(spec, block).Run(); }

std::vector<Eigen::Vector2d> RoofOutline(const BuildingSpec& spec) {
  BlockSolids block;
  BuildBuilding(spec, block);
  const Eigen::Rotation2Dd turn(spec.yaw_rad);
  Eigen::AlignedBox2d box;
  const TriangleMesh& mesh = block.surface.mesh;
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    if (mesh.labels[f] == kFacade) continue;
    for (uint32_t v : mesh.faces[f]) {
      box.extend(turn.inverse() * Eigen::Vector2d(mesh.vertices[v].head<2>() - spec.centre));
    }
  }
  std::vector<Eigen::Vector2d> outline;
  for (const auto corner : {Eigen::AlignedBox2d::BottomLeft, Eigen::AlignedBox2d::BottomRight,
                            Eigen::AlignedBox2d::TopRight, Eigen::AlignedBox2d::TopLeft}) {
    outline.push_back(spec.centre + turn * box.corner(corner));
  }
  return outline;
}

}  // namespace tessera
