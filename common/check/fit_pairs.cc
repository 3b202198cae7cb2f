#include "common/check/fit_pairs.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/check/inspection.h"
#include "common/scene/photographs.h"

namespace tessera {
namespace {

constexpr size_t kSurfacePoints = 20000, kPointsOfView = 100, kMostSurfacePoints = 500000;
constexpr int kPointsOfAnchor = 600;
constexpr size_t kLeastPoints = 20;                                      // of a pair
constexpr double kNarrowestAngle_cos = 0.9985, kWidestAngle_cos = 0.76;  // 3 and 40 degrees

class PairFinder {
 public:
  PairFinder(const SceneDescription& scene, const std::vector<SurfacePoint>& points, const RayCaster& caster,
             double margin_m)
      : scene_(scene), points_(points), caster_(caster), margin_m_(margin_m) {}

  StatusOr<std::vector<FitPair>> Find(const FitOptions& options, const TaskControl& control) const {
    std::vector<int> usable;
    for (size_t v = 0; v < scene_.views.size(); ++v) {
      if (!scene_.views[v].image_path.empty() && !scene_.views[v].withdrawn) usable.push_back(static_cast<int>(v));
    }
    if (usable.size() < 2) return std::vector<FitPair>();
    const int anchors = std::min<int>(static_cast<int>(usable.size()), std::max(1, options.pairs / 2));
    const int partners = std::min<int>((options.pairs + anchors - 1) / anchors, 6);
    std::vector<std::vector<FitPair>> found(anchors);
    ParallelForEach(anchors, 1, [&](int i) {
      if (!control.Check().ok()) return;
      const size_t at = static_cast<size_t>(i) * usable.size() / anchors;
      found[i] = PairsOf(usable[at], usable, partners, options.patches);
    });
    TESSERA_RETURN_IF_ERROR(control.Check());
    std::vector<FitPair> pairs;
    for (std::vector<FitPair>& of_anchor : found) {
      for (FitPair& pair : of_anchor) pairs.push_back(std::move(pair));
    }
    return pairs;
  }

 private:
  bool InFront(int view, const SurfacePoint& p) const {
    const PosedCamera& camera = scene_.views[view].camera;
    const Eigen::Vector3d projected = camera.Project(p.position), ray = p.position - camera.Centre();
    return camera.InImage(projected) && p.normal.dot(ray) < -0.2 * ray.norm();
  }
  bool Sees(int view, const SurfacePoint& p) const {
    if (!InFront(view, p)) return false;
    const Eigen::Vector3d centre = scene_.views[view].camera.Centre();
    return !caster_.Occluded(centre, p.position, std::max(margin_m_, 1e-3 * (p.position - centre).norm()));
  }

  std::vector<FitPair> PairsOf(int reference, const std::vector<int>& usable, int partners, int patches) const {
    std::vector<uint32_t> seen;
    for (uint32_t i = 0; i < points_.size(); ++i) {
      if (InFront(reference, points_[i])) seen.push_back(i);
    }
    Thin(2 * kPointsOfAnchor, &seen);
    std::erase_if(seen, [&](uint32_t i) { return !Sees(reference, points_[i]); });
    Thin(kPointsOfAnchor, &seen);
    const Eigen::Vector3d centre = scene_.views[reference].camera.Centre();
    // Partners by the number of points that they see under a useful angle, different directions first.
    std::vector<std::pair<int, int>> scores;  // -points, view
    for (const int view : usable) {
      if (view == reference) continue;
      const Eigen::Vector3d other = scene_.views[view].camera.Centre();
      int count = 0;
      for (const uint32_t i : seen) {
        const Eigen::Vector3d& p = points_[i].position;
        const double cosine = (centre - p).normalized().dot((other - p).normalized());
        count += cosine < kNarrowestAngle_cos && cosine > kWidestAngle_cos && InFront(view, points_[i]);
      }
      if (count >= static_cast<int>(kLeastPoints)) scores.push_back({-count, view});
    }
    std::sort(scores.begin(), scores.end());
    std::vector<FitPair> pairs;
    for (const auto& [score, view] : scores) {
      if (static_cast<int>(pairs.size()) == partners) break;
      std::vector<uint32_t> common;
      for (const uint32_t i : seen) {
        if (Sees(view, points_[i])) common.push_back(i);
      }
      if (common.size() < kLeastPoints) continue;
      FitPair& pair = pairs.emplace_back(FitPair{reference, view, {}});
      Thin(patches, &common);
      for (const uint32_t i : common) pair.points.push_back(points_[i]);
    }
    return pairs;
  }

  // Keeps at most `count`, evenly spread.
  static void Thin(size_t count, std::vector<uint32_t>* items) {
    if (items->size() <= count) return;
    for (size_t i = 0; i < count; ++i) (*items)[i] = (*items)[i * items->size() / count];
    items->resize(count);
  }

  const SceneDescription& scene_;
  const std::vector<SurfacePoint>& points_;
  const RayCaster& caster_;
  const double margin_m_;
};

FloatImage Halved(const FloatImage& image) {
  FloatImage half(image.width / 2, image.height / 2);
  for (int y = 0; y < half.height; ++y) {
    for (int x = 0; x < half.width; ++x) {
      half.at(x, y) = 0.25f * (image.at(2 * x, 2 * y) + image.at(2 * x + 1, 2 * y) + image.at(2 * x, 2 * y + 1) +
                               image.at(2 * x + 1, 2 * y + 1));
    }
  }
  return half;
}

}  // namespace

std::vector<SurfacePoint> SpreadPoints(const MeshSpans& mesh, size_t count) {
  double area = 0;
  for (size_t f = 0; f < mesh.faces.size(); ++f) area += FaceArea(mesh, f);
  std::vector<SurfacePoint> points;
  const double spacing = area / static_cast<double>(count);
  if (!(spacing > 0) || !std::isfinite(spacing)) return points;
  double next = spacing / 2, passed = 0;
  uint32_t state = 1;
  const auto random = [&state] { return ((state = state * 1664525u + 1013904223u) >> 8) / double{1 << 24}; };
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    passed += FaceArea(mesh, f);
    for (; next < passed; next += spacing) {
      double u = random(), v = random();
      if (u + v > 1) u = 1 - u, v = 1 - v;
      const Eigen::Vector3d a = mesh.Corner(f, 0), b = mesh.Corner(f, 1), c = mesh.Corner(f, 2);
      points.push_back({a + u * (b - a) + v * (c - a), (b - a).cross(c - a).normalized()});
    }
  }
  return points;
}

size_t FitPointsFor(const SceneDescription& scene) {
  return std::clamp(kPointsOfView * scene.views.size(), kSurfacePoints, kMostSurfacePoints);
}

StatusOr<std::vector<FitPair>> FindFitPairs(const SceneDescription& scene, const std::vector<SurfacePoint>& points,
                                            const RayCaster& caster, double margin_m, const FitOptions& options,
                                            const TaskControl& control) {
  return PairFinder(scene, points, caster, margin_m).Find(options, control);
}

StatusOr<FitImages::Image> FitImages::Load(int view) const {
  const SceneView& from = scene_.views[view];
  Image image;
  TESSERA_ASSIGN_OR_RETURN(image.luminance, ReadLuminance(absl::StrCat(scene_.folder, "/", from.image_path), from.lens,
                                                          OptionsOf(scene_.folder, from)));
  while (int64_t{image.luminance.width} * image.luminance.height > largest_pixels_) {
    // An odd last row or column is dropped, so the scale is exactly two.
    image.luminance = Halved(image.luminance);
    image.scale *= 2;
  }
  return image;
}

Status FitImages::Fetch(const std::set<int>& views) const {
  std::vector<std::string> files;
  for (const int view : views) {
    if (images_.contains(view)) continue;
    files.insert(files.end(), {scene_.views[view].image_path, scene_.views[view].mask_path});
  }
  return FetchInScene(scene_.folder, files, fetch_);
}

Status FitImages::Require(const std::set<int>& views) {
  if (images_.size() + views.size() > kept_) {
    std::erase_if(images_, [&](const auto& each) { return !views.contains(each.first); });
  }
  TESSERA_RETURN_IF_ERROR(Fetch(views));
  std::vector<int> missing;
  for (const int view : views) {
    if (!images_.contains(view)) missing.push_back(view);
  }
  std::vector<StatusOr<Image>> read(missing.size());
  ParallelForEach(missing.size(), 1, [&](size_t i) { read[i] = Load(missing[i]); });
  for (size_t i = 0; i < missing.size(); ++i) {
    TESSERA_ASSIGN_OR_RETURN(images_[missing[i]], std::move(read[i]));
  }
  return absl::OkStatus();
}

PatchView FitImages::At(const SceneDescription& scene, int view) const {
  const Image& image = images_.at(view);
  PatchView made{&image.luminance, scene.views[view].camera};
  PinholeCamera& c = made.camera.intrinsics;
  c = {image.luminance.width, image.luminance.height, c.fx / image.scale,
       c.fy / image.scale,    c.cx / image.scale,     c.cy / image.scale};
  return made;
}

std::vector<std::optional<PatchMatch>> MatchPoints(const PatchView& reference, const PatchView& other,
                                                   const std::vector<SurfacePoint>& points, uint32_t seed) {
  std::vector<std::optional<PatchMatch>> matches(points.size());
  ParallelForEach(points.size(), 16, [&](size_t i) {
    matches[i] = MatchPatch(reference, other, points[i], seed + static_cast<uint32_t>(i));
  });
  return matches;
}

}  // namespace tessera
