#include "common/scene/fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <numeric>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/geometry/ray_caster.h"
#include "common/imaging/image_io.h"
#include "common/scene/patch_match.h"
#include "common/scene/photographs.h"

namespace tessera {
namespace {

constexpr int kSurfacePoints = 20000, kPointsOfAnchor = 600;
constexpr int kLargestPixels = 12'000'000;  // larger images are halved until they have fewer pixels
constexpr int kLeastPatches = 10;           // that a median is taken of
// Of a pair with a misplaced view: offset across the epipolar lines, its ratio to that of good pairs, and the share of
// patches above chance beside that of good pairs.
constexpr double kMisplaced_px = 0.7, kMisplacedRatio = 4, kMisplacedShare = 0.4;
constexpr double kNarrowestAngle_cos = 0.9985, kWidestAngle_cos = 0.76;  // 3 and 40 degrees

double Median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Points spread evenly over the area of the mesh, in the order of its faces.
std::vector<SurfacePoint> SpreadPoints(const TriangleMesh& mesh) {
  double area = 0;
  for (size_t f = 0; f < mesh.faces.size(); ++f) area += FaceArea(mesh, f);
  std::vector<SurfacePoint> points;
  const double spacing = area / kSurfacePoints;
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

struct Pair {
  int reference = 0, other = 0;
  std::vector<uint32_t> points;  // seen by both
};

class PairFinder {
 public:
  PairFinder(const SceneDescription& scene, const TriangleMesh& mesh)
      : scene_(scene), caster_(mesh), points_(SpreadPoints(mesh)) {}

  const std::vector<SurfacePoint>& points() const { return points_; }

  // About options.pairs pairs, by reference.
  StatusOr<std::vector<Pair>> Find(const FitOptions& options, const TaskControl& control) const {
    std::vector<int> usable;
    for (size_t v = 0; v < scene_.views.size(); ++v) {
      if (!scene_.views[v].image_path.empty() && !scene_.views[v].withdrawn) usable.push_back(static_cast<int>(v));
    }
    if (usable.size() < 2) return std::vector<Pair>();
    const int anchors = std::min<int>(static_cast<int>(usable.size()), std::max(1, options.pairs / 2));
    const int partners = std::min<int>((options.pairs + anchors - 1) / anchors, 6);
    std::vector<std::vector<Pair>> found(anchors);
    ParallelForEach(anchors, 1, [&](int i) {
      if (!control.Check().ok()) return;
      const size_t at = static_cast<size_t>(i) * usable.size() / anchors;
      found[i] = PairsOf(usable[at], usable, partners, options.patches);
    });
    TESSERA_RETURN_IF_ERROR(control.Check());
    std::vector<Pair> pairs;
    for (std::vector<Pair>& of_anchor : found) {
      for (Pair& pair : of_anchor) pairs.push_back(std::move(pair));
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
    return !caster_.Occluded(centre, p.position, 1e-3 * (p.position - centre).norm());
  }

  std::vector<Pair> PairsOf(int reference, const std::vector<int>& usable, int partners, int patches) const {
    std::vector<uint32_t> seen;
    for (uint32_t i = 0; i < points_.size(); ++i) {
      if (InFront(reference, points_[i])) seen.push_back(i);
    }
    seen = Thinned(seen, 2 * kPointsOfAnchor);
    std::erase_if(seen, [&](uint32_t i) { return !Sees(reference, points_[i]); });
    seen = Thinned(seen, kPointsOfAnchor);
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
      if (count >= 2 * kLeastPatches) scores.push_back({-count, view});
    }
    std::sort(scores.begin(), scores.end());
    std::vector<Pair> pairs;
    for (const auto& [score, view] : scores) {
      if (static_cast<int>(pairs.size()) == partners) break;
      Pair pair{reference, view, {}};
      for (const uint32_t i : seen) {
        if (Sees(view, points_[i])) pair.points.push_back(i);
      }
      if (pair.points.size() < 2 * kLeastPatches) continue;
      pair.points = Thinned(pair.points, patches);
      pairs.push_back(std::move(pair));
    }
    return pairs;
  }

  static std::vector<uint32_t> Thinned(const std::vector<uint32_t>& items, size_t count) {
    if (items.size() <= count) return items;
    std::vector<uint32_t> kept(count);
    for (size_t i = 0; i < count; ++i) kept[i] = items[i * items.size() / count];
    return kept;
  }

  const SceneDescription& scene_;
  const RayCaster caster_;
  const std::vector<SurfacePoint> points_;
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

struct LoadedView {
  FloatImage luminance;
  PatchView view;
  double scale = 1;  // pixels of the file per pixel of luminance
};

StatusOr<std::shared_ptr<const LoadedView>> Load(const SceneDescription& scene, int view) {
  const SceneView& from = scene.views[view];
  auto loaded = std::make_shared<LoadedView>();
  TESSERA_ASSIGN_OR_RETURN(loaded->luminance,
                           ReadLuminance(absl::StrCat(scene.folder, "/", from.image_path), from.lens,
                                         OptionsOf(scene.folder, from)));
  PinholeCamera intrinsics = from.camera.intrinsics;
  while (int64_t{loaded->luminance.width} * loaded->luminance.height > kLargestPixels) {
    // An odd last row or column is dropped, so the scale is exactly two.
    loaded->luminance = Halved(loaded->luminance);
    intrinsics = {loaded->luminance.width, loaded->luminance.height, intrinsics.fx / 2,
                  intrinsics.fy / 2,       intrinsics.cx / 2,        intrinsics.cy / 2};
    loaded->scale *= 2;
  }
  loaded->view.luminance = &loaded->luminance;
  loaded->view.camera = from.camera;
  loaded->view.camera.intrinsics = intrinsics;
  return std::shared_ptr<const LoadedView>(loaded);
}

// The images of the last pairs. Reads missing ones at once, on all threads.
class ImageCache {
 public:
  explicit ImageCache(const SceneDescription& scene) : scene_(scene) {}

  Status Require(const std::set<int>& views) {
    std::erase_if(loaded_, [&](const auto& each) { return !views.contains(each.first); });
    std::vector<int> missing;
    for (const int view : views) {
      if (!loaded_.contains(view)) missing.push_back(view);
    }
    std::vector<StatusOr<std::shared_ptr<const LoadedView>>> read(missing.size(), absl::UnknownError("not read"));
    ParallelForEach(missing.size(), 1, [&](size_t i) { read[i] = Load(scene_, missing[i]); });
    for (size_t i = 0; i < missing.size(); ++i) {
      TESSERA_ASSIGN_OR_RETURN(loaded_[missing[i]], std::move(read[i]));
    }
    return absl::OkStatus();
  }
  const LoadedView& at(int view) const { return *loaded_.at(view); }

 private:
  const SceneDescription& scene_;
  std::map<int, std::shared_ptr<const LoadedView>> loaded_;
};

struct Measured {
  int reference = 0, other = 0;
  double scale = 1;
  std::vector<std::pair<uint32_t, PatchMatch>> matches;  // by surface point
};

struct Tally {
  std::set<int> pairs;
  int64_t patches = 0, above = 0;
  std::vector<double> across, along;

  void Add(int pair, const PatchMatch& match, double scale, double chance) {
    pairs.insert(pair);
    ++patches;
    above += match.correlation > chance;
    if (!match.distinct) return;
    const Eigen::Vector2d& e = match.epipolar_dir;
    across.push_back(scale * std::abs(match.shift_px.x() * e.y() - match.shift_px.y() * e.x()));
    along.push_back(scale * std::abs(match.shift_px.dot(e)));
  }
  FitShare Share() const {
    FitShare share;
    share.pairs = static_cast<int>(pairs.size());
    share.patches = patches;
    if (patches > 0) share.above_chance = static_cast<double>(above) / static_cast<double>(patches);
    if (across.size() >= kLeastPatches) share.across_px = Median(across), share.along_px = Median(along);
    return share;
  }
};

struct PairFigures {
  int reference = 0, other = 0;
  FitShare share;
};

// A view is misplaced if most of its pairs are far worse than those of the other views: their offsets across the
// epipolar lines are larger, or so large that nothing matches.
void FindMisplaced(const std::vector<PairFigures>& pairs, SceneFit* fit) {
  std::vector<double> across, above;
  for (const PairFigures& pair : pairs) {
    above.push_back(pair.share.above_chance);
    if (pair.share.across_px >= 0) across.push_back(pair.share.across_px);
  }
  if (across.size() < 4) return;
  std::sort(across.begin(), across.end());
  std::sort(above.begin(), above.end());
  const double usual_px = across[across.size() / 4];
  const double usual_above = above[3 * above.size() / 4];
  const double far_px = std::max(kMisplaced_px, kMisplacedRatio * usual_px);
  std::vector<std::array<int, 2>> count(fit->views.size());  // pairs, bad ones
  for (const PairFigures& pair : pairs) {
    const bool bad = pair.share.across_px > far_px || pair.share.above_chance < kMisplacedShare * usual_above;
    for (const int view : {pair.reference, pair.other}) {
      ++count[view][0];
      count[view][1] += bad;
    }
  }
  for (size_t v = 0; v < count.size(); ++v) {
    if (count[v][0] >= 3 && count[v][1] > 0.75 * count[v][0]) fit->misplaced.push_back(static_cast<int>(v));
  }
}

// Fits mesh_shift_m and focal_changes to the offsets of all distinct matches, by least absolute values. Offsets across
// the epipolar lines, which the mesh cannot cause, weigh more.
void FitShiftAndFocals(const std::vector<Measured>& pairs, const std::vector<SurfacePoint>& points,
                       const SceneDescription& scene, SceneFit* fit) {
  std::vector<int> camera_of(scene.views.size());
  for (size_t v = 0; v < scene.views.size(); ++v) {
    const auto known = std::find(fit->cameras.begin(), fit->cameras.end(), scene.views[v].lens);
    camera_of[v] = static_cast<int>(known - fit->cameras.begin());
    if (known == fit->cameras.end()) fit->cameras.push_back(scene.views[v].lens);
  }
  const auto unknowns = static_cast<int>(3 + fit->cameras.size());
  fit->focal_changes.assign(fit->cameras.size(), 0);
  struct Row {
    Eigen::Vector3d normal;
    double by_surface = 0, by_focal[2] = {0, 0}, offset = 0;
    int camera[2] = {0, 0};
    bool across = false;
  };
  std::vector<Row> rows;
  for (const Measured& pair : pairs) {
    for (const auto& [point, match] : pair.matches) {
      if (!match.distinct) continue;
      const Eigen::Vector2d& e = match.epipolar_dir;
      for (const bool across : {false, true}) {
        const Eigen::Vector2d direction = across ? Eigen::Vector2d(-e.y(), e.x()) : e;
        rows.push_back({points[point].normal,
                        across ? 0 : match.by_surface.dot(direction),
                        {match.by_reference_focal.dot(direction), match.by_other_focal.dot(direction)},
                        match.shift_px.dot(direction),
                        {camera_of[pair.reference], camera_of[pair.other]},
                        across});
      }
    }
  }
  if (rows.size() < 200) return;
  Eigen::VectorXd solution = Eigen::VectorXd::Zero(unknowns);
  const auto residual = [&](const Row& row) {
    return row.offset - row.by_surface * row.normal.dot(solution.head<3>()) -
           row.by_focal[0] * solution[3 + row.camera[0]] - row.by_focal[1] * solution[3 + row.camera[1]];
  };
  for (int pass = 0; pass < 10; ++pass) {
    std::vector<double> residuals[2];
    for (const Row& row : rows) residuals[row.across].push_back(std::abs(residual(row)));
    const double spread[2] = {std::max(0.02, Median(residuals[0])), std::max(0.02, Median(residuals[1]))};
    Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(unknowns, unknowns);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(unknowns);
    Eigen::VectorXd line(unknowns);
    for (const Row& row : rows) {
      const double relative = std::abs(residual(row)) / spread[row.across];
      const double weight = 1 / (spread[row.across] * spread[row.across] * std::max(relative, 0.1));
      line.setZero();
      line.head<3>() = row.by_surface * row.normal;
      for (const int k : {0, 1}) line[3 + row.camera[k]] += row.by_focal[k];
      matrix.selfadjointView<Eigen::Lower>().rankUpdate(line, weight);
      right += weight * row.offset * line;
    }
    matrix = Eigen::MatrixXd(matrix.selfadjointView<Eigen::Lower>());
    // Directions that no offset depends on stay zero.
    matrix.diagonal() += 1e-4 * matrix.diagonal() + Eigen::VectorXd::Constant(unknowns, 1e-9);
    solution = matrix.ldlt().solve(right);
  }
  fit->mesh_shift_m = solution.head<3>();
  for (size_t c = 0; c < fit->cameras.size(); ++c) fit->focal_changes[c] = solution[3 + static_cast<int>(c)];
}

}  // namespace

StatusOr<SceneFit> MeasureFit(const SceneDescription& scene, const TriangleMesh& mesh, const FitOptions& options,
                              const TaskControl& control) {
  const PairFinder finder(scene, mesh);
  TESSERA_ASSIGN_OR_RETURN(const std::vector<Pair> pairs, finder.Find(options, control));
  ImageCache images(scene);
  std::vector<Measured> measured;
  for (size_t first = 0, last = 0; first < pairs.size(); first = last) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    std::set<int> views;
    for (; last < pairs.size() && pairs[last].reference == pairs[first].reference; ++last) {
      views.insert({pairs[last].reference, pairs[last].other});
    }
    TESSERA_RETURN_IF_ERROR(images.Require(views));
    for (size_t p = first; p < last; ++p) {
      const Pair& pair = pairs[p];
      const LoadedView& reference = images.at(pair.reference);
      std::vector<std::optional<PatchMatch>> matches(pair.points.size());
      ParallelForEach(pair.points.size(), 16, [&](size_t i) {
        matches[i] = MatchPatch(reference.view, images.at(pair.other).view, finder.points()[pair.points[i]],
                                static_cast<uint32_t>(p * 1000 + i));
      });
      Measured& result = measured.emplace_back(Measured{pair.reference, pair.other, reference.scale, {}});
      for (size_t i = 0; i < matches.size(); ++i) {
        if (matches[i]) result.matches.emplace_back(pair.points[i], *std::move(matches[i]));
      }
    }
    control.Report(static_cast<double>(last) / static_cast<double>(pairs.size()), "fit of images and mesh");
  }

  std::vector<float> by_chance;
  for (const Measured& pair : measured) {
    for (const auto& [point, match] : pair.matches) {
      by_chance.insert(by_chance.end(), match.at_random.begin(), match.at_random.end());
    }
  }
  SceneFit fit;
  fit.views.resize(scene.views.size());
  if (by_chance.empty()) return fit;
  const auto limit = by_chance.begin() + static_cast<ptrdiff_t>(by_chance.size() * 19 / 20);
  std::nth_element(by_chance.begin(), limit, by_chance.end());
  const double chance = *limit;

  Tally all;
  std::vector<Tally> of_view(scene.views.size());
  std::vector<PairFigures> of_pair;
  for (size_t p = 0; p < measured.size(); ++p) {
    const Measured& pair = measured[p];
    Tally tally;
    for (const auto& [point, match] : pair.matches) {
      for (Tally* each : {&all, &tally, &of_view[pair.reference], &of_view[pair.other]}) {
        each->Add(static_cast<int>(p), match, pair.scale, chance);
      }
    }
    if (tally.patches >= kLeastPatches) of_pair.push_back({pair.reference, pair.other, tally.Share()});
  }
  fit.all = all.Share();
  for (size_t v = 0; v < scene.views.size(); ++v) fit.views[v] = of_view[v].Share();
  FindMisplaced(of_pair, &fit);
  FitShiftAndFocals(measured, finder.points(), scene, &fit);
  return fit;
}

}  // namespace tessera
