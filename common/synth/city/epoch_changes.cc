#include "common/synth/city/epoch_changes.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "common/base/parallel.h"
#include "common/base/random.h"
#include "common/geometry/ray_caster.h"
#include "common/storage/files.h"
#include "common/synth/city/ring.h"
#include "common/synth/city/surface.h"
#include "common/synth/city/terrain_grid.h"

namespace tessera {
namespace {

using Eigen::AlignedBox2d;
using Eigen::Vector2d;

constexpr double kSquareMetresPerChange = 2500;
constexpr int kMaxChangesPerKind = 12;
constexpr double kMinDistance_m = 3;  // metres between the boxes of two changes
constexpr double kLargeArea = 100;    // square metres; every other change of a kind is at least this large if possible
constexpr double kMaxCoveredShare = 0.2;  // largest share of a footprint that other objects may cover
constexpr int kAttempts = 4000;

using BlockKey = std::pair<int, int>;

// A building or tree of the first epoch.
struct Standing {
  BlockKey block;
  bool is_tree;
  size_t index;  // in the block's list of buildings or trees
  Ring outline;
  AlignedBox2d box;
};

class ChangePlanner {
 public:
  ChangePlanner(const CityPlan& plan, const AlignedBox2d& part, uint64_t seed)
      : plan_(plan),
        grid_(MakeGroundGrid(plan)),
        inner_(Inflated(part, -ChangeInset(part))),
        random_(MixBits(plan.seed ^ 0x6368616e676573ull) ^ MixBits(seed)),
        changed_(std::make_shared<CityChanges>()) {
    count_ = std::clamp(static_cast<int>(std::lround(part.volume() / kSquareMetresPerChange)), 1, kMaxChangesPerKind);
    FindStanding(part);
  }

  ChangedCity Run() {
    for (int round = 0; round < count_; ++round) {
      const bool large = round % 2 == 0;
      Fell();  // first, because few trees are large enough
      Build(large);
      Demolish(large);
      Plant(round % 2 == 1);
      Grow(round % 2 == 1);
      if (round % 3 == 0) Raise();
    }
    for (auto& [key, block] : changed_->blocks) RemoveMarked(key, block);
    CityPlan plan = plan_;
    plan.changes = changed_;
    ParallelForEach(changes_.size(), 1, [&](size_t k) { MeasureHeight(plan, changes_[k]); });
    return {plan, std::move(changes_)};
  }

 private:
  void FindStanding(const AlignedBox2d& part) {
    const AlignedBox2d around = Inflated(part, 12);
    const BlockKey low = plan_.BlockAt(around.min()), high = plan_.BlockAt(around.max());
    std::vector<BlockKey> keys;
    for (int row = low.second; row <= high.second; ++row) {
      for (int column = low.first; column <= high.first; ++column) keys.push_back({column, row});
    }
    std::vector<std::vector<Standing>> found(keys.size());
    ParallelForEach(keys.size(), 1, [&](size_t k) {
      const BlockPlan block = PlanBlock(plan_, keys[k].first, keys[k].second);
      const auto add = [&](bool is_tree, size_t index, Ring outline) {
        const AlignedBox2d box = BoxOf(outline);
        found[k].push_back({keys[k], is_tree, index, std::move(outline), box});
      };
      for (size_t i = 0; i < block.buildings.size(); ++i) add(false, i, RoofOutline(block.buildings[i]));
      for (size_t i = 0; i < block.trees.size(); ++i) add(true, i, CrownOutline(block.trees[i]));
    });
    for (auto& of_block : found) {
      for (Standing& s : of_block) standing_.push_back(std::move(s));
    }
  }

  // Whether the ring lies inside the part with the required margin, and away from other changes.
  bool Free(const Ring& ring, double least_area = kMinChangeArea_m2) const {
    const AlignedBox2d box = BoxOf(ring);
    return inner_.contains(box) && AreaOf(ring) >= least_area &&
           std::none_of(changes_.begin(), changes_.end(), [&](const CityChange& other) {
             return Inflated(BoxOf(other.footprint), kMinDistance_m).intersects(box);
           });
  }

  // Share of the ring covered by objects other than `itself`; `buildings_only`: ignore trees.
  double CoveredShare(const Ring& ring, const std::vector<const Standing*>& itself, bool buildings_only = false) const {
    const AlignedBox2d box = BoxOf(ring);
    std::vector<const Standing*> near;
    for (const Standing& s : standing_) {
      const bool counts = !(buildings_only && s.is_tree) && std::find(itself.begin(), itself.end(), &s) == itself.end();
      if (counts && s.box.intersects(box)) near.push_back(&s);
    }
    if (near.empty()) return 0;
    const Ring points = PointsInside(ring, 0.4);
    const auto covered = std::count_if(points.begin(), points.end(), [&](const Vector2d& p) {
      return std::any_of(near.begin(), near.end(), [&](const Standing* s) { return Inside(s->outline, p); });
    });
    return static_cast<double>(covered) / static_cast<double>(std::max<size_t>(1, points.size()));
  }

  bool Open(const Ring& ring, double clearance_m) const { return CoveredShare(Widened(ring, clearance_m), {}) == 0; }

  BlockPlan& Changed(const BlockKey& key) {
    const auto found = changed_->blocks.find(key);
    if (found != changed_->blocks.end()) return found->second;
    return changed_->blocks.emplace(key, PlanBlock(plan_, key.first, key.second)).first->second;
  }

  void Add(ChangeKind kind, const Ring& ring) {
    CityChange change;
    change.kind = kind;
    for (const Vector2d& p : ring) change.footprint.push_back((p * 1000).array().round() / 1000);
    change.area_m2 = AreaOf(change.footprint);
    changes_.push_back(std::move(change));
  }

  // All trees or all buildings inside the part, in random order.
  std::vector<const Standing*> Shuffled(bool trees) {
    std::vector<const Standing*> list;
    for (const Standing& s : standing_) {
      if (s.is_tree == trees && inner_.contains(s.box)) list.push_back(&s);
    }
    for (size_t k = list.size(); k > 1; --k) std::swap(list[k - 1], list[random_.Below(static_cast<int64_t>(k))]);
    return list;
  }

  Vector2d DrawPosition() {
    return {random_.Uniform(inner_.min().x(), inner_.max().x()), random_.Uniform(inner_.min().y(), inner_.max().y())};
  }

  // Whether the box lies on a block's lot (behind the pavement), not on a street.
  bool OnLot(const AlignedBox2d& box) const {
    const BlockKey key = plan_.BlockAt(box.center());
    const Vector2d low = plan_.BlockOrigin(key.first, key.second);
    const double edge = CityPlan::kHalfStreet + CityPlan::kSidewalk;
    return AlignedBox2d(low + Vector2d::Constant(edge), low + Vector2d::Constant(CityPlan::kPitch - edge))
        .contains(box);
  }

  // Adds a building on open ground: on a lot if possible, else on a street.
  void Build(bool large) {
    for (int attempt = 0; attempt < kAttempts; ++attempt) {
      const bool grand = large && attempt < kAttempts / 2;
      BuildingSpec b;
      b.width_m = grand ? random_.Uniform(11, 15) : random_.Uniform(5.5, 10);
      b.depth_m = grand ? random_.Uniform(8.5, 10) : random_.Uniform(5, 7);
      b.centre = DrawPosition();
      b.yaw_rad = random_.Uniform(-0.05, 0.05) + (random_.Uniform() < 0.5 ? 0 : 1.5707963267948966);
      b.floors = 1 + static_cast<int>(random_.Below(grand ? 4 : 2));
      b.floor_height_m = random_.Uniform(2.8, 3.3);
      b.roof = static_cast<RoofKind>(random_.Below(3));
      b.wall = static_cast<WallKind>(random_.Below(4));
      b.reveal_m = random_.Uniform(0.1, 0.4);
      b.roof_pitch_rad = random_.Uniform(0.55, 0.8);
      b.chimneys = b.roof == RoofKind::kFlat ? 0 : 1;
      b.seed = random_.Bits();
      const Eigen::Rotation2Dd turn(b.yaw_rad);
      Ring walls =
          RectangleOf({Vector2d(-0.5 * b.width_m, -0.5 * b.depth_m), Vector2d(0.5 * b.width_m, 0.5 * b.depth_m)});
      for (Vector2d& p : walls) p = b.centre + turn * p;
      if (attempt % (kAttempts / 2) < kAttempts / 4 && !OnLot(BoxOf(walls))) continue;
      if (!inner_.contains(BoxOf(walls)) || !Open(walls, 0.8)) continue;
      const Ring roof = RoofOutline(b);
      if (!Free(roof) || (grand && AreaOf(roof) < kLargeArea)) continue;
      PlaceOnGround(plan_, b);
      Changed(plan_.BlockAt(b.centre)).buildings.push_back(b);
      return Add(ChangeKind::kBuilt, roof);
    }
  }

  void Raise() {
    for (const Standing* s : Shuffled(false)) {
      if (!Free(s->outline) || CoveredShare(s->outline, {s}) > kMaxCoveredShare) continue;
      Changed(s->block).buildings[s->index].floors += 1 + static_cast<int>(random_.Below(2));
      return Add(ChangeKind::kBuilt, s->outline);
    }
  }

  void Demolish(bool large) {
    std::vector<const Standing*> list = Shuffled(false);
    if (large) {
      std::stable_partition(list.begin(), list.end(),
                            [](const Standing* s) { return AreaOf(s->outline) >= kLargeArea; });
    }
    for (const Standing* s : list) {
      if (!Free(s->outline) || CoveredShare(s->outline, {s}) > kMaxCoveredShare) continue;
      Changed(s->block);
      removed_[s->block].insert({s->is_tree, s->index});
      return Add(ChangeKind::kDemolished, s->outline);
    }
  }

  // Removes a tree or two trees with touching crowns; if none is large enough, the largest tree.
  void Fell() {
    const std::vector<const Standing*> trees = Shuffled(true);
    std::vector<std::vector<const Standing*>> groups;
    for (const Standing* tree : trees) groups.push_back({tree});
    for (size_t a = 0; a < trees.size(); ++a) {
      for (size_t b = a + 1; b < trees.size(); ++b) {
        if (trees[a]->box.intersects(trees[b]->box)) groups.push_back({trees[a], trees[b]});
      }
    }
    const size_t last_resort = groups.size();
    for (const Standing* tree : trees) groups.push_back({tree});
    std::stable_sort(groups.begin() + static_cast<int64_t>(last_resort), groups.end(),
                     [](const auto& a, const auto& b) { return AreaOf(a[0]->outline) > AreaOf(b[0]->outline); });
    for (size_t k = 0; k < groups.size(); ++k) {
      const auto& group = groups[k];
      const std::optional<Ring> ring =
          group.size() == 1 ? group[0]->outline : UnionOf(group[0]->outline, group[1]->outline);
      const double least = k < last_resort ? kMinChangeArea_m2 : kMinFelledArea_m2;
      if (!ring || !Free(*ring, least) || CoveredShare(*ring, group) > kMaxCoveredShare) continue;
      for (const Standing* tree : group) {
        Changed(tree->block);
        removed_[tree->block].insert({true, tree->index});
      }
      return Add(ChangeKind::kFelled, *ring);
    }
  }

  TreeSpec DrawTree(const Vector2d& at, double size_m) {
    TreeSpec t;
    t.foot = {at.x(), at.y(), GroundHeight(plan_, at.x(), at.y())};
    t.radii_m =
        size_m * Eigen::Vector3d(random_.Uniform(0.9, 1.1), random_.Uniform(0.9, 1.1), random_.Uniform(0.9, 1.3));
    t.crown_z_m = t.radii_m.z() + random_.Uniform(0.1, 0.5) * size_m;
    t.seed = static_cast<uint32_t>(random_.Bits());
    return t;
  }

  // Adds a tree on open ground (`fresh`) or enlarges an existing one; falls back to the other.
  void Grow(bool fresh) {
    if (!(fresh ? GrowFresh() || GrowLarger() : GrowLarger() || GrowFresh())) return;
  }

  bool GrowFresh() {
    for (int attempt = 0; attempt < kAttempts; ++attempt) {
      const TreeSpec tree = DrawTree(DrawPosition(), random_.Uniform(3.2, attempt < kAttempts / 2 ? 6.2 : 3.8));
      const Ring crown = CrownOutline(tree);
      if (attempt % (kAttempts / 2) < kAttempts / 4 && !OnLot(BoxOf(crown))) continue;
      if (!Free(crown) || !Open(crown, 0.3)) continue;
      Changed(plan_.BlockAt(tree.foot.head<2>())).trees.push_back(tree);
      Add(ChangeKind::kGrown, crown);
      return true;
    }
    return false;
  }

  bool GrowLarger() {
    for (const Standing* s : Shuffled(true)) {
      const BlockPlan block = PlanBlock(plan_, s->block.first, s->block.second);
      TreeSpec tree = block.trees[s->index];
      const double factor = random_.Uniform(1.6, 2.4);
      tree.radii_m *= factor;
      tree.crown_z_m *= factor;
      const Ring crown = CrownOutline(tree);
      if (!Free(crown) || CoveredShare(crown, {s}, true) > 0 || CoveredShare(crown, {s}) > kMaxCoveredShare) continue;
      Changed(s->block).trees[s->index] = tree;
      Add(ChangeKind::kGrown, crown);
      return true;
    }
    return false;
  }

  // Turns a flat roof (`roof`) or ground into vegetation; falls back to the other.
  void Plant(bool roof) {
    if (!(roof ? PlantRoof() || PlantGround() : PlantGround() || PlantRoof())) return;
  }

  bool PlantRoof() {
    for (const Standing* s : Shuffled(false)) {
      const BuildingSpec b = PlanBlock(plan_, s->block.first, s->block.second).buildings[s->index];
      if (b.roof != RoofKind::kFlat) continue;
      constexpr double kParapet = 0.3;
      const Vector2d half(0.5 * b.width_m - kParapet, 0.5 * b.depth_m - kParapet);
      Ring deck = RectangleOf({-half, half});
      for (Vector2d& p : deck) p = b.centre + Eigen::Rotation2Dd(b.yaw_rad) * p;
      if (!Free(deck) || CoveredShare(deck, {s}) > 0.5 * kMaxCoveredShare) continue;
      Changed(s->block).buildings[s->index].planted = true;
      Add(ChangeKind::kLabel, deck);
      return true;
    }
    return false;
  }

  bool PlantGround() {
    const auto lines_within = [](const std::vector<double>& lines, double low, double high) {
      return std::pair<int64_t, int64_t>(std::lower_bound(lines.begin(), lines.end(), low) - lines.begin(),
                                         std::upper_bound(lines.begin(), lines.end(), high) - lines.begin() - 1);
    };
    const auto [i_low, i_high] = lines_within(grid_.x_lines, inner_.min().x(), inner_.max().x());
    const auto [j_low, j_high] = lines_within(grid_.y_lines, inner_.min().y(), inner_.max().y());
    for (int attempt = 0; attempt < kAttempts; ++attempt) {
      const int longest = attempt < kAttempts / 2 ? 12 : 7;
      const int64_t i = i_low + random_.Below(std::max<int64_t>(1, i_high - i_low)), wide = 4 + random_.Below(longest);
      const int64_t j = j_low + random_.Below(std::max<int64_t>(1, j_high - j_low)), deep = 4 + random_.Below(longest);
      if (i + wide > i_high || j + deep > j_high) continue;
      const AlignedBox2d area(Vector2d(grid_.x_lines[i], grid_.y_lines[j]),
                              Vector2d(grid_.x_lines[i + wide], grid_.y_lines[j + deep]));
      if (attempt % (kAttempts / 2) < kAttempts / 4 && !OnLot(area)) continue;
      const Ring ring = RectangleOf(area);
      if (!Free(ring) || !Open(ring, 0.2)) continue;
      changed_->plantings.push_back({area, static_cast<uint32_t>(random_.Bits())});
      Add(ChangeKind::kLabel, ring);
      return true;
    }
    return false;
  }

  void RemoveMarked(const BlockKey& key, BlockPlan& block) {
    const auto marked = removed_.find(key);
    if (marked == removed_.end()) return;
    for (auto it = marked->second.rbegin(); it != marked->second.rend(); ++it) {
      const auto index = static_cast<int64_t>(it->second);
      if (it->first) {
        block.trees.erase(block.trees.begin() + index);
      } else {
        block.buildings.erase(block.buildings.begin() + index);
      }
    }
  }

  void MeasureHeight(const CityPlan& changed, CityChange& change) const {
    const AlignedBox2d around = Inflated(BoxOf(change.footprint), 8);
    const BlockKey low = plan_.BlockAt(around.min()), high = plan_.BlockAt(around.max());
    const auto caster = [&](const CityPlan& plan) {
      TexturedSurface surface;
      for (int row = low.second; row <= high.second; ++row) {
        for (int column = low.first; column <= high.first; ++column) {
          surface.Append(BuildGround(plan, grid_, column, row));
          surface.Append(BuildBlock(plan, column, row).surface);
        }
      }
      return RayCaster(surface.mesh);
    };
    const RayCaster before = caster(plan_), after = caster(changed);
    const Ring points = PointsInside(change.footprint, 0.2);
    double sum = 0;
    for (const Vector2d& p : points) {
      const Eigen::Vector3d from(p.x(), p.y(), 500), down(0, 0, -1);
      sum += before.Cast(from, down).distance - after.Cast(from, down).distance;
    }
    const double mean = sum / static_cast<double>(std::max<size_t>(1, points.size()));
    change.height_difference_m = std::round(mean * 1000) / 1000 + 0.0;
  }

  const CityPlan plan_;  // of the first epoch
  const GroundGrid grid_;
  const AlignedBox2d inner_;
  Random random_;
  int count_ = 1;
  std::vector<Standing> standing_;
  std::shared_ptr<CityChanges> changed_;
  std::map<BlockKey, std::set<std::pair<bool, size_t>>> removed_;
  std::vector<CityChange> changes_;
};

}  // namespace

double ChangeInset(const Eigen::AlignedBox2d& part) { return std::min(4.0, 0.05 * part.sizes().minCoeff()); }

ChangedCity ChangeCity(const CityPlan& plan, const Eigen::AlignedBox2d& part, uint64_t seed) {
  return ChangePlanner(plan, part, seed).Run();
}

Status WriteChanges(const std::string& path, const std::vector<CityChange>& changes) {
  nlohmann::ordered_json features = nlohmann::ordered_json::array();
  for (const CityChange& change : changes) {
    nlohmann::ordered_json ring = nlohmann::ordered_json::array();
    for (size_t k = 0; k <= change.footprint.size(); ++k) {
      const Eigen::Vector2d& p = change.footprint[k % change.footprint.size()];
      ring.push_back({p.x(), p.y()});
    }
    features.push_back({{"type", "Feature"},
                        {"properties",
                         {{"kind", ChangeKindName(change.kind)},
                          {"area_m2", std::round(change.area_m2 * 1000) / 1000},
                          {"height_difference_m", change.height_difference_m}}},
                        {"geometry", {{"type", "Polygon"}, {"coordinates", nlohmann::ordered_json::array({ring})}}}});
  }
  const nlohmann::ordered_json collection = {{"type", "FeatureCollection"}, {"features", std::move(features)}};
  return WriteFileAtomic(path, collection.dump(1) + "\n");
}

}  // namespace tessera
