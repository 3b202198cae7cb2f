#include "common/exporting/color/point_colors.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <optional>
#include <tuple>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/exporting/color/color_pyramid.h"
#include "common/geometry/csr_rows.h"
#include "common/geometry/ray_caster.h"

namespace tessera {
namespace {

constexpr int64_t kPointGrain = 4096;
constexpr double kLeastCosine = 0.17;    // 80 degrees between normal and ray
constexpr double kTolerance_gsd = 2;     // of surfaces in front of a point
constexpr double kFeather_share = 0.05;  // of the image's smaller side
constexpr int kHighestLevel = 6;

// A view that sees a point.
struct Sighting {
  int32_t view = -1;  // -1: none
  float weight = 0;
};

// How a view shows a point.
struct Projection {
  double x = 0, y = 0;  // pixels of the undistorted image
  double gsd_m = 0;
};

std::optional<Projection> ViewProjection(const PosedCamera& camera, const Eigen::Vector3d& point) {
  const Eigen::Vector3d p = camera.Project(point);
  if (!camera.InImage(p)) return std::nullopt;
  return Projection{p.x(), p.y(), p.z() / std::sqrt(camera.intrinsics.fx * camera.intrinsics.fy)};
}

// 0 at the rim of the image and 1 at kFeather_share of its smaller side inside.
double RimFeather(const PinholeCamera& camera, const Projection& p) {
  const double rim_px = std::min({p.x, p.y, camera.width - p.x, camera.height - p.y});
  return std::min(1.0, rim_px / (kFeather_share * std::min(camera.width, camera.height)));
}

// The pyramid level whose pixels are at most half of the spacing: bilinear interpolation reaches over two of them.
int ColorLevelOf(const PointColorInput& input, size_t point, double gsd_m) {
  if (input.spacing_m.empty()) return 0;
  const double level = std::log2(0.5 * input.spacing_m[point] / gsd_m);
  return level > 0 ? std::min(static_cast<int>(level), kHighestLevel) : 0;
}

// The centres of all views.
std::vector<Eigen::Vector3d> ViewCentres(std::span<const SceneView> views) {
  std::vector<Eigen::Vector3d> centres;
  centres.reserve(views.size());
  for (const SceneView& view : views) centres.push_back(view.camera.Centre());
  return centres;
}

class ViewChooser {
 public:
  explicit ViewChooser(const PointColorInput& input) : input_(input), centres_(ViewCentres(input.views)) {
    for (const MeshSpans& mesh : input.occluders) casters_.emplace_back(mesh);
  }

  // Writes the best views of the point to `best`, by falling weight; the others stay as they are.
  void Choose(size_t point, std::span<Sighting> best) const {
    struct Candidate {
      int32_t view;
      double weight, gsd_m;
    };
    std::vector<Candidate> candidates;
    const Eigen::Vector3d p = input_.points[point];
    const Eigen::Vector3d normal = input_.normals[point].cast<double>();
    for (size_t v = 0; v < input_.views.size(); ++v) {
      if (input_.view_files[v].empty()) continue;
      const PosedCamera& camera = input_.views[v].camera;
      const std::optional<Projection> projection = ViewProjection(camera, p);
      if (!projection) continue;
      const double cosine = normal.isZero() ? 1 : normal.dot((centres_[v] - p).normalized());
      const double weight =
          cosine * RimFeather(camera.intrinsics, *projection) / (projection->gsd_m * projection->gsd_m);
      if (cosine < kLeastCosine || !(weight > 0)) continue;
      candidates.push_back({static_cast<int32_t>(v), weight, projection->gsd_m});
    }
    std::sort(candidates.begin(), candidates.end(), [&](const Candidate& a, const Candidate& b) {
      return a.weight != b.weight ? a.weight > b.weight : input_.views[a.view].name < input_.views[b.view].name;
    });
    size_t found = 0;
    for (const Candidate& candidate : candidates) {
      if (found == best.size()) return;
      if (IsHidden(p, normal, candidate.view, candidate.gsd_m)) continue;
      best[found++] = {candidate.view, static_cast<float>(candidate.weight)};
    }
  }

 private:
  // A ray from a point that is lifted from the surface by half of the tolerance.
  bool IsHidden(const Eigen::Vector3d& p, const Eigen::Vector3d& normal, int view, double gsd_m) const {
    const double margin_m = 0.5 * kTolerance_gsd * gsd_m;
    const Eigen::Vector3d from = p + margin_m * normal;
    return std::any_of(casters_.begin(), casters_.end(),
                       [&](const RayCaster& caster) { return caster.Occluded(from, centres_[view], margin_m); });
  }

  const PointColorInput& input_;
  std::vector<Eigen::Vector3d> centres_;
  std::vector<RayCaster> casters_;
};

// The sightings of each view: indices into `sightings`, ascending.
CsrRows SightingsOfViews(std::span<const Sighting> sightings, size_t views) {
  CsrRows rows;
  rows.offsets.assign(views + 1, 0);
  for (const Sighting& s : sightings) {
    if (s.view >= 0) ++rows.offsets[s.view + 1];
  }
  for (size_t v = 0; v < views; ++v) rows.offsets[v + 1] += rows.offsets[v];
  rows.items.resize(static_cast<size_t>(rows.offsets.back()));
  std::vector<int64_t> next(rows.offsets.begin(), rows.offsets.end() - 1);
  for (size_t i = 0; i < sightings.size(); ++i) {
    if (sightings[i].view >= 0) rows.items[next[sightings[i].view]++] = static_cast<uint32_t>(i);
  }
  return rows;
}

// The part of an image, and the highest pyramid level, that its sightings need.
struct NeededPart {
  ImagePart part = {std::numeric_limits<int>::max(), std::numeric_limits<int>::max(), 0, 0};
  int level = 0;
};

// Reads the colours of the sightings of view `v`; NaN where the photograph has none.
Status ReadSightings(const PointColorInput& input, size_t v, std::span<const uint32_t> sightings, size_t per_point,
                     std::vector<Eigen::Vector3f>* values) {
  const SceneView& view = input.views[v];
  NeededPart needed;
  for (const uint32_t s : sightings) {
    const size_t point = s / per_point;
    const Projection p = *ViewProjection(view.camera, input.points[point]);
    const int x = static_cast<int>(p.x), y = static_cast<int>(p.y);
    needed.part = {std::min(needed.part.x0, x), std::min(needed.part.y0, y), std::max(needed.part.x1, x + 1),
                   std::max(needed.part.y1, y + 1)};
    needed.level = std::max(needed.level, ColorLevelOf(input, point, p.gsd_m));
  }
  PhotographOptions options;
  options.white_level = view.white_level;
  if (!input.mask_files.empty()) options.mask_path = input.mask_files[v];
  TESSERA_ASSIGN_OR_RETURN(const ColorPyramid pyramid,
                           ColorPyramid::Read(input.view_files[v], view.lens, needed.part, needed.level, options));
  ParallelForEach(sightings.size(), kPointGrain, [&](size_t i) {
    const size_t point = sightings[i] / per_point;
    const Projection p = *ViewProjection(view.camera, input.points[point]);
    (*values)[sightings[i]] = pyramid.At(p.x, p.y, ColorLevelOf(input, point, p.gsd_m));
  });
  return absl::OkStatus();
}

struct WeightedValue {
  float value = 0, weight = 0;
};

// The weighted median, interpolated between values: continuous in the weights, the mean of two values of equal weight.
float WeightedMedian(std::span<WeightedValue> values) {
  std::sort(values.begin(), values.end(),
            [](const auto& a, const auto& b) { return std::tie(a.value, a.weight) < std::tie(b.value, b.weight); });
  float total = 0;
  for (const WeightedValue& v : values) total += v.weight;
  float below = 0, last_at = 0, last_value = values[0].value;
  for (const WeightedValue& v : values) {
    const float at = below + 0.5f * v.weight;
    if (at >= 0.5f * total) {
      return at > last_at && below > 0 ? last_value + (v.value - last_value) * (0.5f * total - last_at) / (at - last_at)
                                       : v.value;
    }
    last_at = at;
    last_value = v.value;
    below += v.weight;
  }
  return last_value;
}

// The colour by the first `most` sightings that have pixels; returns their number.
uint8_t CombineSightings(std::span<const Sighting> sightings, std::span<const Eigen::Vector3f> values, int most,
                         Rgb* color) {
  std::array<WeightedValue, 255> samples;
  int count = 0;
  for (int c = 0; c < 3; ++c) {
    count = 0;
    for (size_t i = 0; i < sightings.size() && count < most; ++i) {
      if (sightings[i].view >= 0 && values[i].allFinite()) samples[count++] = {values[i][c], sightings[i].weight};
    }
    if (count == 0) return 0;
    const float value = WeightedMedian({samples.data(), static_cast<size_t>(count)});
    (*color)[c] = static_cast<uint8_t>(std::lround(255 * std::clamp(value, 0.f, 1.f)));
  }
  return static_cast<uint8_t>(count);
}

Status CheckPointColorInput(const PointColorInput& input) {
  const bool fits = input.normals.size() == input.points.size() && input.view_files.size() == input.views.size() &&
                    (input.mask_files.empty() || input.mask_files.size() == input.views.size()) &&
                    (input.spacing_m.empty() || input.spacing_m.size() == input.points.size());
  if (fits && input.views_per_point >= 1 && input.views_per_point <= 100) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(
      "colours of points: found ", input.normals.size(), " normals, ", input.spacing_m.size(), " spacings and ",
      input.view_files.size(), " files for ", input.points.size(), " points and ", input.views.size(), " views, and ",
      input.views_per_point, " views per point; expected one for each, and 1 to 100 views per point"));
}

}  // namespace

Status ColorPoints(const PointColorInput& input, std::vector<Rgb>* colors, std::vector<uint8_t>* seen,
                   const TaskControl& control) {
  TESSERA_RETURN_IF_ERROR(CheckPointColorInput(input));
  const size_t points = input.points.size();
  colors->assign(points, Rgb{});
  seen->assign(points, 0);
  // Masked pixels are known only after the photograph is read, so more views are chosen.
  bool masked = std::any_of(input.mask_files.begin(), input.mask_files.end(), [](const auto& f) { return !f.empty(); });
  for (const SceneView& view : input.views) masked = masked || view.masked;
  const auto per_point = static_cast<size_t>(input.views_per_point * (masked ? 2 : 1));

  std::vector<Sighting> sightings(points * per_point);
  {
    const ViewChooser chooser(input);
    std::atomic<bool> cancelled = false;
    ParallelFor(static_cast<int64_t>(points), kPointGrain, [&](int64_t begin, int64_t end) {
      if (cancelled || !control.Check().ok()) {
        cancelled = true;
        return;
      }
      for (int64_t i = begin; i < end; ++i) {
        chooser.Choose(static_cast<size_t>(i), {sightings.data() + i * per_point, per_point});
      }
    });
    TESSERA_RETURN_IF_ERROR(control.Check());
  }
  const CsrRows of_view = SightingsOfViews(sightings, input.views.size());
  std::vector<Eigen::Vector3f> values(sightings.size());
  for (size_t v = 0; v < input.views.size(); ++v) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(0.5 + 0.5 * static_cast<double>(v) / static_cast<double>(input.views.size()),
                   absl::StrCat("colours of ", input.views[v].name));
    if (of_view[v].empty()) continue;
    TESSERA_RETURN_IF_ERROR(ReadSightings(input, v, of_view[v], per_point, &values));
  }
  ParallelForEach(points, kPointGrain, [&](size_t i) {
    (*seen)[i] =
        CombineSightings(std::span(sightings).subspan(i * per_point, per_point),
                         std::span(values).subspan(i * per_point, per_point), input.views_per_point, &(*colors)[i]);
  });
  return absl::OkStatus();
}

}  // namespace tessera
