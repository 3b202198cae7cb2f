#include "common/check/fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "common/base/parallel.h"
#include "common/check/fit_pairs.h"
#include "common/check/patch_match.h"
#include "common/geometry/ray_caster.h"

namespace tessera {
namespace {

constexpr int kLeastPatches = 10;  // that a median is taken of
// Of a pair with a misplaced view. The offset across the epipolar line is above the lower quartile of all pairs by this
// many times the distance from there to the 5 % quantile: both are those of good pairs, as long as a third of the pairs
// are good, and the distance is about a standard deviation. Less than the first bound costs no accuracy. Or the share
// of patches above chance is below this share of that of good pairs.
constexpr double kMisplaced_px = 0.7, kMisplacedSpreads = 8, kMisplacedShare = 0.4;
constexpr double kNoFitDeviations = 5;
constexpr size_t kLeastPairs = 4;           // that a quantile is taken of
constexpr double kUpperQuartile = 1.15035;  // of the absolute value of a standard normal variable
// Shifts of the mesh to the sides that are tried, for every n-th patch.
constexpr double kTrialShifts_m[] = {2, 5};
constexpr int kTrialDirections = 4, kTrials = 2 * kTrialDirections;
constexpr size_t kPatchesOfTrial = 3;

double Median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double MedianSize(std::vector<double> values) {
  for (double& value : values) value = std::abs(value);
  return Median(std::move(values));
}

struct Tally {
  std::set<int> pairs;
  int64_t patches = 0, above = 0;
  std::vector<double> across, along;  // signed

  void Add(int pair, const PatchMatch& match, double scale, double chance) {
    pairs.insert(pair);
    ++patches;
    above += match.correlation > chance;
    if (!match.distinct) return;
    const Eigen::Vector2d& e = match.epipolar_dir;
    across.push_back(scale * (match.shift_px.x() * e.y() - match.shift_px.y() * e.x()));
    along.push_back(scale * match.shift_px.dot(e));
  }
  FitShare Share() const {
    FitShare share;
    share.pairs = static_cast<int>(pairs.size());
    share.patches = patches;
    if (patches > 0) share.above_chance = static_cast<double>(above) / static_cast<double>(patches);
    if (across.size() >= kLeastPatches) share.across_px = MedianSize(across), share.along_px = MedianSize(along);
    return share;
  }
};

// A view is misplaced if its pairs with most of its partners are far worse than those of the other views: their offsets
// across the epipolar lines are larger, or so large that nothing matches. Both pairs of two views count once: an error
// along their epipolar lines shows in neither.
void FindMisplaced(const std::vector<FitPairShare>& pairs, SceneFit* fit) {
  std::vector<double> across, above;
  for (const FitPairShare& pair : pairs) {
    above.push_back(pair.share.above_chance);
    if (pair.share.across_px >= 0) across.push_back(pair.share.across_px);
  }
  if (across.size() < kLeastPairs) return;
  std::sort(across.begin(), across.end());
  std::sort(above.begin(), above.end());
  const double usual_px = across[across.size() / 4], small_px = across[across.size() / 20];
  const double usual_above = above[3 * above.size() / 4];
  const double far_px = std::max(kMisplaced_px, usual_px + kMisplacedSpreads * (usual_px - small_px));
  std::vector<int> count(fit->views.size());                     // of pairs
  std::vector<std::map<int, bool>> partners(fit->views.size());  // whether a pair with them is bad
  for (const FitPairShare& pair : pairs) {
    const bool bad = pair.share.across_px > far_px || pair.share.above_chance < kMisplacedShare * usual_above;
    for (const auto& [view, partner] : {std::pair(pair.reference, pair.other), std::pair(pair.other, pair.reference)}) {
      ++count[view];
      partners[view][partner] |= bad;
    }
  }
  for (size_t v = 0; v < count.size(); ++v) {
    const auto bad =
        std::count_if(partners[v].begin(), partners[v].end(), [](const auto& each) { return each.second; });
    if (count[v] >= 3 && static_cast<double>(bad) > 0.75 * static_cast<double>(partners[v].size())) {
      fit->misplaced.push_back(static_cast<int>(v));
    }
  }
}

// SceneFit::pose_error_px. Errors of the poses shift all patches of a pair alike, and those of single matches cancel in
// its median. Errors of e pixels in random directions in both images give medians with a standard deviation of e. It is
// taken from the upper quartile, which a few wrong pairs do not change.
double PoseError(const std::vector<FitPairShare>& pairs, const std::vector<int>& misplaced) {
  std::vector<double> medians;
  const auto is_misplaced = [&](int view) { return std::binary_search(misplaced.begin(), misplaced.end(), view); };
  for (const FitPairShare& pair : pairs) {
    if (pair.share.across_px < 0 || is_misplaced(pair.reference) || is_misplaced(pair.other)) continue;
    medians.push_back(std::abs(pair.signed_across_px));
  }
  if (medians.size() < kLeastPairs) return -1;
  std::sort(medians.begin(), medians.end());
  return medians[3 * medians.size() / 4] / kUpperQuartile;
}

// Fits mesh_shift_m and focal_changes to the offsets of all distinct matches, by least absolute values. Offsets across
// the epipolar lines, which the mesh cannot cause, weigh more.
void FitShiftAndFocals(const std::vector<FitMatches>& pairs, SceneFit* fit) {
  const auto unknowns = static_cast<int>(3 + fit->cameras.size());
  struct Row {
    Eigen::Vector3d normal;
    double by_surface = 0, by_focal[2] = {0, 0}, offset = 0;
    int camera[2] = {0, 0};
    bool across = false;
  };
  std::vector<Row> rows;
  for (const FitMatches& pair : pairs) {
    for (const auto& [point, match] : pair.matches) {
      if (!match.distinct) continue;
      const Eigen::Vector2d& e = match.epipolar_dir;
      for (const bool across : {false, true}) {
        const Eigen::Vector2d direction = across ? Eigen::Vector2d(-e.y(), e.x()) : e;
        rows.push_back({point.normal,
                        across ? 0 : match.by_surface.dot(direction),
                        {match.by_reference_focal.dot(direction), match.by_other_focal.dot(direction)},
                        match.shift_px.dot(direction),
                        {fit->camera_of[pair.reference], fit->camera_of[pair.other]},
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

// The share above chance that says something: see SceneFit::least_above_chance. The number of matches by chance varies
// more between pairs than that of independent patches would.
double LeastAboveChance(const std::vector<FitMatches>& pairs, double limit, int64_t patches) {
  double squares = 0, expected = 0;
  for (const FitMatches& pair : pairs) {
    double above = 0, count = 0;
    for (const auto& [point, match] : pair.matches) {
      count += static_cast<double>(match.at_random.size());
      for (const float value : match.at_random) above += value > limit;
    }
    const double difference = above - kChanceShare * count;
    squares += difference * difference;
    expected += kChanceShare * (1 - kChanceShare) * count;
  }
  const double excess = expected > 0 ? std::max(1.0, squares / expected) : 1;
  const double deviation =
      std::sqrt(excess * kChanceShare * (1 - kChanceShare) / static_cast<double>(std::max<int64_t>(patches, 1)));
  return std::max(3 * kChanceShare, kChanceShare + kNoFitDeviations * deviation);
}

// The ZNCC of patches if the mesh were moved; NaN where they leave an image or lack texture.
using TrialScores = std::array<float, kTrials>;

TrialScores TryShifts(const PatchView& reference, const PatchView& other, const SurfacePoint& point,
                      const Eigen::Vector3d& up) {
  const Eigen::Vector3d side = up.unitOrthogonal(), front = up.cross(side);
  TrialScores scores;
  for (int t = 0; t < kTrials; ++t) {
    const Eigen::Vector3d& axis = t % 2 == 0 ? side : front;
    const double shift_m = kTrialShifts_m[t / kTrialDirections] * (t % kTrialDirections < 2 ? 1 : -1);
    scores[t] = CorrelatePatch(reference, other, {point.position + shift_m * axis, point.normal});
  }
  return scores;
}

// SceneFit::sideways_deviations, from the scores in place and of the trials.
double SidewaysDeviations(const std::vector<std::pair<float, TrialScores>>& trials, double limit) {
  double largest = 0;
  for (int t = 0; t < kTrials; ++t) {
    double more = 0, less = 0;
    for (const auto& [in_place, moved] : trials) {
      if (!std::isfinite(moved[t])) continue;
      more += moved[t] > limit && in_place <= limit;
      less += moved[t] <= limit && in_place > limit;
    }
    if (more + less > 0) largest = std::max(largest, (more - less) / std::sqrt(more + less));
  }
  return largest;
}

}  // namespace

double ChanceLimit(const std::vector<FitMatches>& pairs) {
  std::vector<float> by_chance;
  for (const FitMatches& pair : pairs) {
    for (const auto& [point, match] : pair.matches) {
      by_chance.insert(by_chance.end(), match.at_random.begin(), match.at_random.end());
    }
  }
  if (by_chance.empty()) return 1;
  const auto limit = by_chance.begin() + static_cast<ptrdiff_t>(by_chance.size() * 19 / 20);
  std::nth_element(by_chance.begin(), limit, by_chance.end());
  return *limit;
}

SceneFit SumUpFit(const SceneDescription& scene, const std::vector<FitMatches>& pairs) {
  SceneFit fit;
  fit.views.resize(scene.views.size());
  fit.camera_of.resize(scene.views.size());
  for (size_t v = 0; v < scene.views.size(); ++v) {
    const auto known = std::find(fit.cameras.begin(), fit.cameras.end(), scene.views[v].lens);
    fit.camera_of[v] = static_cast<int>(known - fit.cameras.begin());
    if (known == fit.cameras.end()) fit.cameras.push_back(scene.views[v].lens);
  }
  fit.camera_shares.resize(fit.cameras.size());
  fit.focal_changes.assign(fit.cameras.size(), 0);
  const double chance = ChanceLimit(pairs);
  Tally all;
  std::vector<Tally> of_view(scene.views.size()), of_camera(fit.cameras.size());
  for (size_t p = 0; p < pairs.size(); ++p) {
    const FitMatches& pair = pairs[p];
    Tally tally;
    std::set<Tally*> tallies = {&all, &tally, &of_view[pair.reference], &of_view[pair.other]};
    for (const int view : {pair.reference, pair.other}) tallies.insert(&of_camera[fit.camera_of[view]]);
    for (const auto& [point, match] : pair.matches) {
      for (Tally* each : tallies) each->Add(static_cast<int>(p), match, pair.scale, chance);
    }
    if (tally.patches < kLeastPatches) continue;
    fit.pairs.push_back({pair.reference, pair.other, tally.Share(), tally.across.empty() ? 0 : Median(tally.across)});
  }
  fit.all = all.Share();
  fit.least_above_chance = LeastAboveChance(pairs, chance, fit.all.patches);
  for (size_t v = 0; v < of_view.size(); ++v) fit.views[v] = of_view[v].Share();
  for (size_t c = 0; c < of_camera.size(); ++c) fit.camera_shares[c] = of_camera[c].Share();
  FindMisplaced(fit.pairs, &fit);
  fit.pose_error_px = PoseError(fit.pairs, fit.misplaced);
  FitShiftAndFocals(pairs, &fit);
  return fit;
}

StatusOr<SceneFit> MeasureFit(const SceneDescription& scene, const FitSurface& surface, const FitOptions& options,
                              const TaskControl& control, const FetchFiles& fetch) {
  TESSERA_ASSIGN_OR_RETURN(const std::vector<FitPair> pairs,
                           FindFitPairs(scene, SpreadPoints(surface.mesh, FitPointsFor(scene)),
                                        RayCaster(*surface.occluders), surface.margin_m, options, control));
  FitImages images(scene, fetch);
  std::vector<FitMatches> measured(pairs.size());
  std::vector<std::pair<float, TrialScores>> trials;
  TESSERA_RETURN_IF_ERROR(ForEachFitPair(pairs, &images, control, [&](size_t p) {
    const FitPair& pair = pairs[p];
    const PatchView reference = images.At(scene, pair.reference), other = images.At(scene, pair.other);
    std::vector<std::optional<PatchMatch>> matches =
        MatchPoints(reference, other, pair.points, static_cast<uint32_t>(p * 1000));
    std::vector<TrialScores> scores(pair.points.size());
    ParallelForEach(pair.points.size(), 16, [&](size_t i) {
      if (matches[i] && i % kPatchesOfTrial == 0) {
        scores[i] = TryShifts(reference, other, pair.points[i], scene.up_in_local);
      }
    });
    measured[p] = {pair.reference, pair.other, images.Scale(pair.reference), {}};
    for (size_t i = 0; i < matches.size(); ++i) {
      if (!matches[i]) continue;
      if (i % kPatchesOfTrial == 0) trials.emplace_back(static_cast<float>(matches[i]->correlation), scores[i]);
      measured[p].matches.push_back({pair.points[i], *std::move(matches[i])});
    }
  }));
  SceneFit fit = SumUpFit(scene, measured);
  fit.sideways_deviations = SidewaysDeviations(trials, ChanceLimit(measured));
  return fit;
}

}  // namespace tessera
