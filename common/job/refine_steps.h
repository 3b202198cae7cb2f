// The sequence of steps of a refinement, for the planner (tasks of tiles) and for jobs of one tile.
#pragma once

#include <string>
#include <vector>

#include "common/job/method_settings.h"

namespace tessera {

inline constexpr int kTesseraRounds = 2, kBaselineRounds = 1, kPaperRounds = 5;

// Which directions of the view pairs an iteration evaluates. Forward: the view that is later in the job's order is
// warped into the earlier one.
enum class PairDirections { kBoth, kForward, kBackward };

struct RefineStep {
  int round = -1;           // -1: before the first round
  int level = -1;           // pyramid level of a geometry step; -1: label step
  int iteration = 0;        // counted over all levels of the round
  bool ends_level = false;  // the last iteration of its level; self-intersections are repaired after it
  PairDirections directions = PairDirections::kBoth;
  bool labels() const { return level < 0; }
  bool first() const { return round < 0; }
};

// The index (coarsest first) of the level at which a round starts: the first round at the coarsest level, later rounds
// at the finest. Coarser levels would blur the surface that the first round refined.
size_t FirstLevelOf(int round, size_t levels);

// A label step, then in each round the iterations of its levels and a label step. The first label step always exists,
// but does nothing for some methods. `levels` and `iterations` have the same length. `short_rounds`: rounds after the
// first have half the iterations, rounded up. `alternate`: each iteration evaluates one direction of the pairs, and the
// next iteration, also of another level or round, the other.
std::vector<RefineStep> MakeRefineSteps(const std::vector<int>& levels, const std::vector<int>& iterations, int rounds,
                                        bool short_rounds, bool alternate);

// The steps of a job. `rounds` 0 and unset settings mean the method's defaults. CheckMethod must accept the settings.
std::vector<RefineStep> RefineStepsOf(const std::string& method, int rounds, const MethodSettings& settings);

// The rules of a method for rounds, labels and flips, after applying the settings.
struct MethodRules {
  int rounds = kTesseraRounds;
  bool labels_first = true;          // solve the labels also before the first round
  bool geometry_uses_labels = true;  // false: the geometry ignores labels
  bool moves = true;                 // false: only labels are solved
  bool flips_edges = true;           // flip edges of the published mesh
  // As MakeRefineSteps. Alternating takes half the work, and the result is as near to the truth or nearer
  // (tests/bench/speed.md).
  bool short_rounds = true, alternate = true;
  // Split faces again before the finest level. A method without this splits them once, at the start.
  bool splits_twice = true;
};
MethodRules MethodRulesOf(const std::string& method, int rounds, const MethodSettings& settings);

// A job may split large faces twice. Its coarse part moves a mesh of larger faces on the coarse levels. Then the moved
// surface is split, and the fine part has the finest level of the first round and all later steps.
enum class JobPart { kWhole, kCoarse, kFine };

// Index of the first step of the fine part; 0: the job splits faces once.
int FirstFineStep(const std::vector<RefineStep>& steps, const MethodRules& rules);

// Whether a step of such a job belongs to the part.
inline bool IsStepOf(JobPart part, int step, int first_fine) {
  return part == JobPart::kWhole || (step < first_fine) == (part == JobPart::kCoarse);
}

// The properties of a scene that determine which label steps act.
struct LabelTraits {
  int classes = 0;
  bool has_likelihoods = false;
  bool has_labels = false;  // of the start mesh
};

// Whether a label step acts. It needs likelihoods and at least two classes. The step before the first round acts only
// if the method requests it, or if its geometry uses labels and the start mesh has none (paper, section 3).
bool LabelStepActs(const RefineStep& step, const MethodRules& rules, const LabelTraits& scene);

// Ascending indices of the steps that act: all iterations, and the label steps with LabelStepActs.
std::vector<int> ActiveSteps(const std::vector<RefineStep>& steps, const MethodRules& rules, const LabelTraits& scene);

}  // namespace tessera
