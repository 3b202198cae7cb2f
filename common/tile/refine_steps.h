// The steps of a refinement, one after another, which may be shared out among several tasks a tile.
#ifndef TESSERA_COMMON_TILE_REFINE_STEPS_H_
#define TESSERA_COMMON_TILE_REFINE_STEPS_H_

#include <string>
#include <vector>

#include "common/tile/method_settings.h"

namespace tessera {

inline constexpr int kPaperRounds = 5;

struct RefineStep {
  int round = -1;     // -1: before the first
  int level = -1;     // pyramid level that vertices move on; -1: labels are solved
  int iteration = 0;  // counted over all levels of the round
  bool labels() const { return level < 0; }
};

// Labels first (a step even where a method has none there: it does nothing), then in each round the iterations of all
// levels and labels again. `levels` and `iterations` are as long.
std::vector<RefineStep> MakeRefineSteps(const std::vector<int>& levels, const std::vector<int>& iterations, int rounds);

// Those of a job: `rounds` 0 and empty settings are the method's own. Settings as CheckMethod accepts them.
std::vector<RefineStep> RefineStepsOf(const std::string& method, int rounds, const MethodSettings& settings);

}  // namespace tessera

#endif  // TESSERA_COMMON_TILE_REFINE_STEPS_H_
