// The steps of a refinement, one after another: what the plan makes tasks of, and what a tile's own refinement does.
#ifndef TESSERA_COMMON_JOB_REFINE_STEPS_H_
#define TESSERA_COMMON_JOB_REFINE_STEPS_H_

#include <string>
#include <vector>

#include "common/job/method_settings.h"

namespace tessera {

inline constexpr int kTesseraRounds = 2, kBaselineRounds = 1, kPaperRounds = 5;

struct RefineStep {
  int round = -1;           // -1: before the first
  int level = -1;           // pyramid level that vertices move on; -1: labels are solved
  int iteration = 0;        // counted over all levels of the round
  bool ends_level = false;  // the last iteration of its level: folds are mended after it
  bool labels() const { return level < 0; }
  bool first() const { return round < 0; }
};

// Index of the level that a round begins at, of so many, coarsest first: the first round at the coarsest, later ones at
// the finest. What images show at coarser levels the surface has by then, and going back there blurs it.
size_t FirstLevelOf(int round, size_t levels);

// Labels first (a step even where a method has none there: it does nothing), then in each round the iterations of its
// levels and labels again. `levels` and `iterations` are as long.
std::vector<RefineStep> MakeRefineSteps(const std::vector<int>& levels, const std::vector<int>& iterations, int rounds);

// Those of a job: `rounds` 0 and empty settings are the method's own. Settings as CheckMethod accepts them.
std::vector<RefineStep> RefineStepsOf(const std::string& method, int rounds, const MethodSettings& settings);

// What a method does about rounds, labels and flips where its settings leave it open, and what they ask for where not.
struct MethodRules {
  int rounds = kTesseraRounds;
  bool labels_first = true;           // labels are solved before the first geometry too
  bool geometry_knows_labels = true;  // false: the geometry sees a mesh without labels
  bool moves = true;                  // false: labels alone
  bool flips_edges = true;            // of the faces that are published
};
MethodRules MethodRulesOf(const std::string& method, int rounds, const MethodSettings& settings);

// What of a scene decides which label steps act.
struct LabelTraits {
  int classes = 0;
  bool has_likelihoods = false;
  bool has_labels = false;  // the start has
};

// Whether a label step does anything: where likelihoods can change labels, always but before the first round; there if
// the method wants it, or if its geometry knows labels and the start has none (paper, section 3).
bool LabelStepActs(const RefineStep& step, const MethodRules& rules, const LabelTraits& scene);

// Indices, ascending, of the steps that do something: all iterations, and the label steps that act.
std::vector<int> ActiveSteps(const std::vector<RefineStep>& steps, const MethodRules& rules, const LabelTraits& scene);

}  // namespace tessera

#endif  // TESSERA_COMMON_JOB_REFINE_STEPS_H_
