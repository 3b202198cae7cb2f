#include "common/importing/proof/proof.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/base/parallel.h"
#include "common/importing/proof/alternatives.h"

namespace tessera {
namespace {

constexpr int64_t kProvenObservations = 20;                         // fewer prove nothing
constexpr int64_t kFewObservations = 100;                           // of tie points: then control points count, too
constexpr int64_t kScreened = 2000;                                 // observations that all alternatives are tried on
constexpr size_t kListedAlternatives = 10, kShownAlternatives = 5;  // alternatives
constexpr int kMostChanges = 3;                                     // alternatives that are combined
// An alternative fits better if its median is lower by a tenth and by more than rounding, and if more observations
// prefer it than by chance, in standard deviations. A format has a few readings, but there are hundreds of
// alternatives.
constexpr double kBetterShare = 0.9, kRounding_px = 0.01, kReadingDeviations = 2, kAlternativeDeviations = 4;
// Images with bad residuals.
constexpr double kBadImage = 3, kBadImage_px = 0.1;
constexpr int64_t kLeastOfImage = 10;
constexpr double kBadControl = 3;

int64_t CountPointObservations(const std::vector<BlockTiePoint>& points) {
  int64_t count = 0;
  for (const BlockTiePoint& point : points) count += static_cast<int64_t>(point.observations.size());
  return count;
}

// The block with every n-th tie point, about `observations` of them.
ImportedBlock SampleOf(const ImportedBlock& block, int64_t observations) {
  ImportedBlock sample;
  sample.cameras = block.cameras;
  sample.images = block.images;
  const int64_t count = CountPointObservations(block.points);
  const auto step = static_cast<size_t>(std::max<int64_t>(1, count / std::max<int64_t>(1, observations)));
  for (size_t i = 0; i < block.points.size(); i += step) sample.points.push_back(block.points[i]);
  if (count < kFewObservations) {
    sample.points.insert(sample.points.end(), block.control_points.begin(), block.control_points.end());
  }
  return sample;
}

std::vector<float> SampleResiduals(const ImportedBlock& sample) { return ResidualsOf(sample, sample.points); }

double MedianResidual(std::vector<float> residuals) { return SummariseResiduals(std::move(residuals)).median_px; }

bool FitsBetter(const std::vector<float>& other, const std::vector<float>& as_read, double deviations) {
  const double other_px = MedianResidual(other), read_px = MedianResidual(as_read);
  if (!(other_px < kBetterShare * read_px && other_px < read_px - kRounding_px)) return false;
  double better = 0, worse = 0;
  for (size_t i = 0; i < other.size(); ++i) {
    better += other[i] < as_read[i];
    worse += other[i] > as_read[i];
  }
  return better - worse >= deviations * std::sqrt(better + worse);
}

std::vector<float> ResidualsWith(const ImportedBlock& sample, const BlockReading& reading) {
  ImportedBlock changed = sample;
  reading.apply(&changed);
  return SampleResiduals(changed);
}

// Applies readings of the format as long as one fits better, the best first.
void ApplyReadings(ImportedBlock* block, const ProofOptions& options, Proof* proof) {
  ImportedBlock sample = SampleOf(*block, options.sampled);
  std::vector<float> current = SampleResiduals(sample);
  for (const BlockReading& reading : block->readings) {
    proof->readings.push_back({reading.name, SummariseResiduals(ResidualsWith(sample, reading)), false, false});
  }
  const double as_read_px = MedianResidual(current);
  for (size_t pass = 0; pass < block->readings.size(); ++pass) {
    size_t best = block->readings.size();
    std::vector<float> of_best = current;
    for (size_t i = 0; i < block->readings.size(); ++i) {
      if (proof->readings[i].is_applied) continue;
      std::vector<float> residuals = ResidualsWith(sample, block->readings[i]);
      if (!FitsBetter(residuals, current, kReadingDeviations) || MedianResidual(residuals) >= MedianResidual(of_best))
        continue;
      best = i;
      of_best = std::move(residuals);
    }
    if (best == block->readings.size()) break;
    block->readings[best].apply(&sample);
    block->readings[best].apply(block);
    proof->readings[best].is_better = proof->readings[best].is_applied = true;
    block->conventions.push_back(absl::StrCat(
        "Read with ", block->readings[best].name, ": the residuals of tie points are ",
        ResidualText(MedianResidual(of_best)), " in the median, instead of ", ResidualText(as_read_px), "."));
    current = std::move(of_best);
  }
  proof->sample = SummariseResiduals(std::move(current));
}

// To sort by: alternatives that fit most observations equally well may differ in the rest.
std::pair<double, double> RankOf(const ResidualSummary& residuals) {
  return {std::round(residuals.median_px / kRounding_px), residuals.p95_px};
}

struct AlternativeTrial {
  std::string name;
  std::vector<size_t> changes;  // indices of alternatives, applied in this order
  ResidualSummary residuals;
};

ImportedBlock WithChanges(const ImportedBlock& sample, const std::vector<BlockReading>& alternatives,
                          const std::vector<size_t>& changes) {
  ImportedBlock changed = sample;
  for (const size_t change : changes) alternatives[change].apply(&changed);
  return changed;
}

// All alternatives on top of `base` that change its residuals, the best first. Of several with the same residuals, the
// first.
std::vector<AlternativeTrial> TryAllAlternatives(const ImportedBlock& screened,
                                                 const std::vector<BlockReading>& alternatives,
                                                 const AlternativeTrial& base) {
  const ImportedBlock start = WithChanges(screened, alternatives, base.changes);
  std::vector<AlternativeTrial> trials(alternatives.size());
  ParallelForEach(alternatives.size(), 8, [&](size_t i) {
    AlternativeTrial& trial = trials[i];
    trial.name = base.name.empty() ? alternatives[i].name : absl::StrCat(base.name, ", ", alternatives[i].name);
    trial.changes = base.changes;
    trial.changes.push_back(i);
    trial.residuals = SummariseResiduals(ResidualsWith(start, alternatives[i]));
  });
  std::stable_sort(trials.begin(), trials.end(), [](const AlternativeTrial& a, const AlternativeTrial& b) {
    return RankOf(a.residuals) < RankOf(b.residuals);
  });
  const auto is_same = [](const ResidualSummary& a, const ResidualSummary& b) {
    const auto is_close = [](double x, double y) { return x == y || std::abs(x - y) <= 1e-5 * std::min(x, y); };
    return is_close(a.median_px, b.median_px) && is_close(a.p95_px, b.p95_px);
  };
  const ResidualSummary unchanged = SummariseResiduals(SampleResiduals(start));
  std::erase_if(trials, [&](const AlternativeTrial& trial) { return is_same(unchanged, trial.residuals); });
  trials.erase(std::unique(trials.begin(), trials.end(),
                           [&](const AlternativeTrial& a, const AlternativeTrial& b) {
                             return is_same(a.residuals, b.residuals);
                           }),
               trials.end());
  return trials;
}

void TryAlternatives(const ImportedBlock& block, const ProofOptions& options, Proof* proof) {
  const ImportedBlock sample = SampleOf(block, options.sampled), screened = SampleOf(block, kScreened);
  std::vector<BlockReading> alternatives = LensAlternatives();
  for (BlockReading& pose : PoseAlternatives()) alternatives.push_back(std::move(pose));
  std::vector<AlternativeTrial> found = TryAllAlternatives(screened, alternatives, {});
  if (found.size() > kListedAlternatives) found.resize(kListedAlternatives);
  // A file may differ by several conventions. Each further one has to fit better than those before.
  std::vector<float> best = SampleResiduals(screened);
  for (int changes = 1; changes < kMostChanges && !found.empty(); ++changes) {
    const AlternativeTrial base = found.front();
    std::vector<float> residuals = SampleResiduals(WithChanges(screened, alternatives, base.changes));
    if (!FitsBetter(residuals, best, kAlternativeDeviations)) break;
    best = std::move(residuals);
    const std::vector<AlternativeTrial> further = TryAllAlternatives(screened, alternatives, base);
    if (further.empty() || !FitsBetter(SampleResiduals(WithChanges(screened, alternatives, further.front().changes)),
                                       best, kAlternativeDeviations)) {
      break;
    }
    found.insert(found.begin(), further.front());
  }
  const std::vector<float> as_read = SampleResiduals(sample);
  for (const AlternativeTrial& trial : found) {
    const std::vector<float> residuals = SampleResiduals(WithChanges(sample, alternatives, trial.changes));
    proof->alternatives.push_back(
        {trial.name, SummariseResiduals(residuals), FitsBetter(residuals, as_read, kAlternativeDeviations), false});
  }
  std::stable_sort(proof->alternatives.begin(), proof->alternatives.end(),
                   [](const auto& a, const auto& b) { return RankOf(a.residuals) < RankOf(b.residuals); });
}

// Residuals of tie points by image and camera.
void MeasureRows(const ImportedBlock& block, const std::vector<float>& residuals, Proof* proof) {
  std::vector<std::vector<float>> of_image(block.images.size()), of_camera(block.cameras.size());
  size_t at = 0;
  for (const BlockTiePoint& point : block.points) {
    for (const BlockObservation& observation : point.observations) {
      const float residual = residuals[at++];
      if (!std::isnan(residual)) of_image[static_cast<size_t>(observation.image)].push_back(residual);
    }
  }
  for (size_t i = 0; i < of_image.size(); ++i) {
    if (of_image[i].empty()) continue;
    std::vector<float>& camera = of_camera[static_cast<size_t>(block.images[i].camera)];
    camera.insert(camera.end(), of_image[i].begin(), of_image[i].end());
    const ProofRow row = {block.images[i].path, SummariseResiduals(std::move(of_image[i]))};
    if (row.residuals.observations >= kLeastOfImage && row.residuals.median_px > kBadImage_px &&
        row.residuals.median_px > kBadImage * proof->tie_points.median_px) {
      proof->bad_images.push_back(static_cast<int>(proof->images.size()));
    }
    proof->images.push_back(row);
  }
  for (size_t i = 0; i < of_camera.size(); ++i) {
    if (of_camera[i].empty()) continue;
    const std::string& name = block.cameras[i].name;
    proof->cameras.push_back(
        {name.empty() ? absl::StrCat("camera ", i) : name, SummariseResiduals(std::move(of_camera[i]))});
  }
}

// Stores the positions of tie points that have none, and removes those that cannot be triangulated.
void StorePositions(ImportedBlock* block, Proof* proof) {
  std::vector<char> is_missing(block->points.size(), 0);
  ParallelForEach(block->points.size(), 256, [&](size_t i) {
    BlockTiePoint& point = block->points[i];
    if (HasPosition(point)) return;
    const std::optional<Eigen::Vector3d> position = TriangulatePoint(*block, point);
    if (position) point.position = *position;
    is_missing[i] = position ? 1 : 2;
  });
  proof->triangulated = std::count(is_missing.begin(), is_missing.end(), 1);
  proof->not_triangulated = std::count(is_missing.begin(), is_missing.end(), 2);
  if (!proof->is_proven || proof->not_triangulated == 0) return;
  size_t kept = 0;
  for (size_t i = 0; i < block->points.size(); ++i) {
    if (is_missing[i] == 2) continue;
    if (kept != i) block->points[kept] = std::move(block->points[i]);
    ++kept;
  }
  block->points.resize(kept);
  block->left_out.push_back(absl::StrCat(
      proof->not_triangulated, " tie points without a position, because the rays of their images do not intersect"));
}

}  // namespace

std::string ResidualText(double residual_px) {
  return std::isfinite(residual_px) ? absl::StrFormat("%.3f px", residual_px) : "infinity (points behind the cameras)";
}

Proof MeasureProof(ImportedBlock* block, const ProofOptions& options) {
  Proof proof;
  ApplyReadings(block, options, &proof);
  const std::vector<float> residuals = ResidualsOf(*block, block->points);
  proof.tie_points = SummariseResiduals(residuals);
  proof.control_points = SummariseResiduals(ResidualsOf(*block, block->control_points));
  MeasureRows(*block, residuals, &proof);
  if (options.alternatives && proof.sample.observations > 0) TryAlternatives(*block, options, &proof);
  proof.is_proven = proof.sample.observations >= kProvenObservations && proof.sample.median_px <= options.max_error_px;
  StorePositions(block, &proof);
  return proof;
}

Status JudgeProof(const ImportedBlock& block, const Proof& proof, const ProofOptions& options, Warnings* warnings) {
  const std::string file = block.files.empty() ? block.format : block.files.front();
  if (proof.sample.observations > 0 && !(proof.sample.median_px <= options.max_error_px)) {
    std::string expected = absl::StrFormat("at most %g px (--max-error-px): lenses and poses that fit the tie points",
                                           options.max_error_px);
    for (size_t i = 0; i < std::min(proof.alternatives.size(), kShownAlternatives); ++i) {
      const ProofAlternative& other = proof.alternatives[i];
      absl::StrAppend(&expected, "\n  ", ResidualText(other.residuals.median_px), " with ", other.name);
    }
    return InputError(file, "tie points",
                      absl::StrCat("a median residual of ", ResidualText(proof.sample.median_px), " (",
                                   proof.sample.observations, " observations)"),
                      expected);
  }
  if (!proof.alternatives.empty() && proof.alternatives.front().is_better) {
    const ProofAlternative& best = proof.alternatives.front();
    warnings->push_back(absl::StrCat(file, ": tie points fit better with ", best.name, ": ",
                                     ResidualText(best.residuals.median_px), " in the median instead of ",
                                     ResidualText(proof.sample.median_px),
                                     ": check the convention of the program that wrote the file"));
  }
  if (!proof.bad_images.empty()) {
    std::string names;
    for (size_t i = 0; i < std::min<size_t>(proof.bad_images.size(), 20); ++i) {
      const ProofRow& row = proof.images[static_cast<size_t>(proof.bad_images[i])];
      absl::StrAppend(&names, i > 0 ? ", " : "", row.name, " (", ResidualText(row.residuals.median_px), ")");
    }
    if (proof.bad_images.size() > 20) absl::StrAppend(&names, " and ", proof.bad_images.size() - 20, " more");
    warnings->push_back(absl::StrCat(file, ": ", proof.bad_images.size(), " of ", proof.images.size(),
                                     " images have median residuals over three times that of all (",
                                     ResidualText(proof.tie_points.median_px), "): ", names));
  }
  const double control_px = proof.control_points.median_px;
  if (proof.tie_points.observations >= kFewObservations && control_px > options.max_error_px &&
      control_px > kBadControl * proof.tie_points.median_px) {
    warnings->push_back(absl::StrCat(file, ": control points do not fit: a median residual of ",
                                     ResidualText(control_px), ", that of tie points is ",
                                     ResidualText(proof.tie_points.median_px),
                                     ": check their coordinate reference system"));
  }
  return absl::OkStatus();
}

StatusOr<Proof> ProveByTiePoints(ImportedBlock* block, const ProofOptions& options, Warnings* warnings) {
  Proof proof = MeasureProof(block, options);
  TESSERA_RETURN_IF_ERROR(JudgeProof(*block, proof, options, warnings));
  return proof;
}

}  // namespace tessera
