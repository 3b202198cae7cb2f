#include "common/evaluate/likelihood_scores.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/evaluate/label_rendering.h"

namespace tessera {
namespace {

StatusOr<ConfusionMatrix> ConfuseView(size_t view, const LensModel& lens, int classes, const TruthLabelSource& truth,
                                      const LikelihoodSource& likelihoods) {
  ConfusionMatrix confusion(classes);
  TESSERA_ASSIGN_OR_RETURN(const LabelImage stored, truth(view));
  if (stored.empty()) return confusion;
  const LabelImage labels = UndistortLabels(stored, lens);
  TESSERA_ASSIGN_OR_RETURN(const FloatImage values, likelihoods(view));
  for (int y = 0; y < labels.height; ++y) {
    const int from_y = std::min(values.height - 1, y * values.height / labels.height);
    for (int x = 0; x < labels.width; ++x) {
      if (labels.at(x, y) == 255) continue;
      const int from_x = std::min(values.width - 1, x * values.width / labels.width);
      int best = 0;
      for (int c = 1; c < classes; ++c) {
        if (values.at(from_x, from_y, c) > values.at(from_x, from_y, best)) best = c;
      }
      confusion.Add(labels.at(x, y), best);
    }
  }
  return confusion;
}

}  // namespace

StatusOr<std::vector<ConfusionMatrix>> ConfuseLikelihoods(const std::vector<LensModel>& lenses, int classes,
                                                          const TruthLabelSource& truth,
                                                          const LikelihoodSource& likelihoods) {
  std::vector<StatusOr<ConfusionMatrix>> found(lenses.size(), absl::InternalError("not compared"));
  ParallelFor(static_cast<int64_t>(lenses.size()), 1,
              [&](int64_t v, int64_t) { found[v] = ConfuseView(v, lenses[v], classes, truth, likelihoods); });
  std::vector<ConfusionMatrix> confusions;
  for (StatusOr<ConfusionMatrix>& confusion : found) {
    TESSERA_RETURN_IF_ERROR(confusion.status());
    confusions.push_back(*std::move(confusion));
  }
  return confusions;
}

}  // namespace tessera
