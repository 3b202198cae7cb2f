#include "worker/changes/change_areas.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "worker/changes/cell_mask.h"

namespace tessera {
namespace {

constexpr double kWeakShare = 0.6;          // of the threshold: enough next to a cell above it
constexpr double kMinLabelAgreement = 0.5;  // minimum ChangeArea::agreement for a change of class
constexpr double kFollowedShare = 0.7;      // of an area's cells that the refined mesh must show

enum class Sign { kHigher, kLower, kEqual };

ClassRole RoleOf(const std::vector<ClassRole>& roles, uint8_t label) {
  return label < roles.size() ? roles[label] : ClassRole::kOther;
}

uint8_t MostFrequent(const std::vector<uint8_t>& labels, const std::vector<size_t>& cells) {
  std::array<size_t, 256> votes{};
  for (const size_t i : cells) ++votes[labels[i]];
  const auto best = std::max_element(votes.begin(), votes.end() - 1);
  return *best > 0 ? static_cast<uint8_t>(best - votes.begin()) : kNoLabel;
}

CellRect Around(const CellRect& a, const CellRect& b) {
  return {std::min(a.x0, b.x0), std::min(a.y0, b.y0), std::max(a.x1, b.x1), std::max(a.y1, b.y1)};
}

// Finds the areas of one raster.
class AreaFinder {
 public:
  AreaFinder(const ChangeRaster& raster, const SurfaceRaster* refined, const std::vector<ClassRole>& roles,
             double gsd_m, const ChangeAreaOptions& options)
      : raster_(raster),
        refined_(refined),
        roles_(roles),
        options_(options),
        threshold_m_(HeightThreshold_m(options, gsd_m)) {}

  std::vector<ChangeArea> Find() {
    std::vector<std::pair<size_t, ChangeArea>> found;
    for (const Sign sign : {Sign::kHigher, Sign::kLower, Sign::kEqual}) {
      CellMask weak(raster_.before.width(), raster_.before.height()), strong = weak;
      for (size_t i = 0; i < weak.flag.size(); ++i) {
        weak.flag[i] = Differs(i, sign, kWeakShare);
        strong.flag[i] = Differs(i, sign, 1);
      }
      const double min_width_cells = std::max(options_.min_width_m / raster_.cell_m(), options_.min_width_cells);
      const CellMask clean = WithoutSlivers(Majority(weak), static_cast<int>(std::ceil(min_width_cells)));
      for (const std::vector<size_t>& part : ConnectedParts(clean, strong)) {
        if (const std::optional<ChangeArea> area = Describe(part, sign)) found.push_back({part.front(), *area});
      }
    }
    std::stable_sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    std::vector<ChangeArea> areas;
    for (auto& [first, area] : found) areas.push_back(std::move(area));
    return areas;
  }

 private:
  bool Differs(size_t i, Sign sign, double share) const {
    const double difference_m = raster_.after.height_m[i] - raster_.before.height_m[i];  // NaN: unknown
    if (sign == Sign::kHigher) return difference_m > share * threshold_m_;
    if (sign == Sign::kLower) return -difference_m > share * threshold_m_;
    if (!(std::abs(difference_m) <= kWeakShare * threshold_m_)) return false;
    const uint8_t before = raster_.before.label[i], after = raster_.after.label[i];
    if (before == kNoLabel || after == kNoLabel || !ClassesDiffer(roles_, before, after)) return false;
    return raster_.label_margin[i] > share * options_.label_margin;
  }

  std::optional<ChangeArea> Describe(const std::vector<size_t>& cells, Sign sign) const {
    const double cell_m = raster_.cell_m(), count = static_cast<double>(cells.size());
    ChangeArea area;
    area.area_m2 = count * cell_m * cell_m;
    if (area.area_m2 < (sign == Sign::kEqual ? options_.min_label_area_m2 : options_.min_area_m2)) return {};
    area.low_m = std::numeric_limits<double>::infinity();
    area.high_m = -area.low_m;
    double known = 0, right = 0;
    area.label_before = MostFrequent(raster_.before.label, cells);
    area.label_after = MostFrequent(raster_.after.label, cells);
    for (const size_t i : cells) {
      const int x = static_cast<int>(i % raster_.before.width()), y = static_cast<int>(i / raster_.before.width());
      area.cells.emplace_back(raster_.cells().x0 + x, raster_.cells().y0 + y);
      area.place.head<2>() += cell_m * (area.cells.back().cast<double>() + Eigen::Vector2d::Constant(0.5)) / count;
      const double difference_m = raster_.after.height_m[i] - raster_.before.height_m[i];
      if (std::isnan(difference_m)) continue;  // filled in by the majority filter
      known += 1;
      for (const double height_m : {raster_.before.height_m[i], raster_.after.height_m[i]}) {
        area.low_m = std::min(area.low_m, height_m);
        area.high_m = std::max(area.high_m, height_m);
      }
      area.place.z() += raster_.after.height_m[i];
      area.height_difference_m += difference_m;
      area.agreement += raster_.after_score[i];
      area.agreement_before += std::isnan(raster_.before_score[i]) ? 0 : raster_.before_score[i];
      right += Followed(i, sign, area.label_after);
    }
    if (known == 0) return {};
    area.place.z() /= known;
    area.height_difference_m /= known;
    area.agreement /= known;
    area.agreement_before /= known;
    if (sign == Sign::kEqual && area.agreement < kMinLabelAgreement) return {};
    area.volume_m3 = sign == Sign::kEqual ? 0 : area.area_m2 * area.height_difference_m;
    if (sign != Sign::kEqual && (area.agreement < options_.min_agreement ||
                                 area.agreement - area.agreement_before < options_.min_agreement_gain)) {
      return {};
    }
    if (sign == Sign::kEqual) {
      area.kind = ChangeKind::kLabel;
    } else if (sign == Sign::kHigher) {
      const bool plants = RoleOf(roles_, area.label_after) == ClassRole::kVegetation;
      area.kind = plants ? ChangeKind::kGrown : ChangeKind::kBuilt;
    } else {
      const bool plants = RoleOf(roles_, area.label_before) == ClassRole::kVegetation;
      area.kind = plants ? ChangeKind::kFelled : ChangeKind::kDemolished;
    }
    if (refined_ != nullptr) area.followed = right >= kFollowedShare * known;
    area.outline = TraceOutline(area.cells);
    for (Eigen::Vector2d& p : area.outline.outer) p *= cell_m;
    area.outline.outer = SimplifyRing(area.outline.outer, options_.simplify_cells * cell_m);
    for (Ring& hole : area.outline.holes) {
      for (Eigen::Vector2d& p : hole) p *= cell_m;
      hole = SimplifyRing(hole, options_.simplify_cells * cell_m);
    }
    return area;
  }

  // Whether the refined mesh agrees with the images at this cell.
  bool Followed(size_t i, Sign sign, uint8_t label_after) const {
    if (refined_ == nullptr) return false;
    if (sign == Sign::kEqual) return refined_->label[i] == label_after;
    return std::abs(refined_->height_m[i] - raster_.after.height_m[i]) <= kWeakShare * threshold_m_;
  }

  const ChangeRaster& raster_;
  const SurfaceRaster* refined_;
  const std::vector<ClassRole>& roles_;
  const ChangeAreaOptions& options_;
  double threshold_m_;
};

}  // namespace

std::vector<ClassRole> ClassRoles(const std::vector<SceneClass>& classes) {
  std::vector<ClassRole> roles;
  for (const SceneClass& c : classes) {
    roles.push_back(c.name == "ground"                       ? ClassRole::kGround
                    : c.name == "roof" || c.name == "facade" ? ClassRole::kBuilding
                    : c.name == "vegetation"                 ? ClassRole::kVegetation
                                                             : ClassRole::kOther);
  }
  return roles;
}

double HeightThreshold_m(const ChangeAreaOptions& options, double gsd_m) {
  return std::max(options.height_m, options.height_gsd * gsd_m);
}

bool ClassesDiffer(const std::vector<ClassRole>& roles, uint8_t a, uint8_t b) {
  return a != b && !(RoleOf(roles, a) == ClassRole::kBuilding && RoleOf(roles, b) == ClassRole::kBuilding);
}

SurfaceRaster MergeSurfaces(std::span<const SurfaceRaster> rasters, const CellRect& cells, double cell_m) {
  SurfaceRaster merged(cells, cell_m);
  for (const SurfaceRaster& raster : rasters) CopyCells(raster, cells, &merged);
  return merged;
}

ChangeRaster MergeRasters(std::span<const ChangeRaster> rasters) {
  if (rasters.empty()) return {};
  CellRect rect = rasters[0].cells();
  for (const ChangeRaster& raster : rasters) rect = Around(rect, raster.cells());
  ChangeRaster merged(rect, rasters[0].cell_m());
  for (const ChangeRaster& raster : rasters) CopyCells(raster, rect, &merged);
  return merged;
}

std::vector<ChangeArea> FindChangeAreas(std::span<const ChangeRaster> rasters, std::span<const SurfaceRaster> refined,
                                        const std::vector<ClassRole>& roles, double gsd_m,
                                        const ChangeAreaOptions& options) {
  if (rasters.empty()) return {};
  const ChangeRaster merged = MergeRasters(rasters);
  const SurfaceRaster shown = MergeSurfaces(refined, merged.cells(), merged.cell_m());
  return AreaFinder(merged, refined.empty() ? nullptr : &shown, roles, gsd_m, options).Find();
}

}  // namespace tessera
