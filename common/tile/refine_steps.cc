#include "common/tile/refine_steps.h"

namespace tessera {

std::vector<RefineStep> MakeRefineSteps(const std::vector<int>& levels, const std::vector<int>& iterations,
                                        int rounds) {
  std::vector<RefineStep> steps = {RefineStep()};
  for (int round = 0; round < rounds; ++round) {
    int iteration = 0;
    for (size_t i = 0; i < levels.size(); ++i) {
      for (int k = 0; k < iterations[i]; ++k) steps.push_back({round, levels[i], iteration++});
    }
    steps.push_back({round, -1, iteration});
  }
  return steps;
}

std::vector<RefineStep> RefineStepsOf(const std::string& method, int rounds, const MethodSettings& settings) {
  const auto or_standard = [](const ListSetting& list, const std::vector<int>& value) {
    return value.empty() ? list.standard : value;
  };
  if (rounds == 0) rounds = method == "paper" ? kPaperRounds : 1;
  return MakeRefineSteps(or_standard(ListSettings()[0], settings.levels),
                         or_standard(ListSettings()[1], settings.iterations), rounds);
}

}  // namespace tessera
