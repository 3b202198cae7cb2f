#include "common/evaluate/likelihood_scores.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/evaluate/label_rendering.h"

namespace tessera {
namespace {

StatusOr<LikelihoodConfusion> ConfuseView(const std::vector<SceneView>& views, size_t view, int classes,
                                          const TruthLabelSource& truth, const LikelihoodSource& likelihoods,
                                          const LabelRendering& rendering) {
  LikelihoodConfusion confusion{views[view].name, ConfusionMatrix(classes), ConfusionMatrix(classes)};
  TESSERA_ASSIGN_OR_RETURN(const LabelImage stored, truth(view));
  if (stored.empty()) return confusion;
  const LabelImage labels = UndistortLabels(stored, views[view].lens);
  TESSERA_ASSIGN_OR_RETURN(const FloatImage values, likelihoods(view));
  const LabelImage rendered = rendering ? rendering(view) : LabelImage();
  for (int y = 0; y < labels.height; ++y) {
    const int from_y = std::min(values.height - 1, y * values.height / labels.height);
    for (int x = 0; x < labels.width; ++x) {
      if (labels.at(x, y) == 255 || (!rendered.empty() && rendered.at(x, y) == 255)) continue;
      const int from_x = std::min(values.width - 1, x * values.width / labels.width);
      int best = 0;
      for (int c = 1; c < classes; ++c) {
        if (values.at(from_x, from_y, c) > values.at(from_x, from_y, best)) best = c;
      }
      confusion.likelihoods.Add(labels.at(x, y), best);
      if (!rendered.empty()) confusion.mesh.Add(labels.at(x, y), rendered.at(x, y));
    }
  }
  return confusion;
}

}  // namespace

StatusOr<std::vector<LikelihoodConfusion>> ConfuseLikelihoods(const std::vector<SceneView>& views, int classes,
                                                              const TruthLabelSource& truth,
                                                              const LikelihoodSource& likelihoods,
                                                              const LabelRendering& rendering) {
  std::vector<StatusOr<LikelihoodConfusion>> found(views.size(), absl::InternalError("not compared"));
  ParallelForEach(views.size(), 1,
                  [&](size_t v) { found[v] = ConfuseView(views, v, classes, truth, likelihoods, rendering); });
  std::vector<LikelihoodConfusion> confusions;
  for (StatusOr<LikelihoodConfusion>& confusion : found) {
    TESSERA_RETURN_IF_ERROR(confusion.status());
    if (confusion->likelihoods.total() > 0) confusions.push_back(*std::move(confusion));
  }
  return confusions;
}

}  // namespace tessera
