#include "worker/tile/tile_step.h"

namespace tessera {

std::vector<TileStep> TileStepsOf(const std::vector<RefineStep>& steps) {
  int finest = -1;
  for (const RefineStep& step : steps) {
    if (!step.labels()) finest = step.level;
  }
  std::vector<TileStep> out;
  for (const RefineStep& step : steps) {
    TileStep at = {step, 0, !step.labels() && step.level == finest};
    if (!out.empty() && out.back().step.level == step.level && out.back().step.round == step.round) {
      at.level_iteration = out.back().level_iteration + 1;
    }
    out.push_back(at);
  }
  return out;
}

}  // namespace tessera
