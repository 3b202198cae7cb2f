// Between which steps tiles hear from each other.
#ifndef TESSERA_SERVER_PLAN_PARTS_H_
#define TESSERA_SERVER_PLAN_PARTS_H_

#include <vector>

#include "common/tile/refine_steps.h"
#include "server/settings/job_settings.h"

namespace tessera {

// Steps [begin, end) of a tile's refinement: a task.
struct StepRange {
  int begin = 0, end = 0;
  friend bool operator==(const StepRange&, const StepRange&) = default;
};

// Ranges, one after the other, that hold every step. A tile does not see what lies outside its halo move, and each step
// carries that error inwards, the farther the coarser its level and the wider its windows; a range ends, and tiles take
// from each other what each has right, before the error is expected to reach what the tile's result is used for. A
// narrow halo costs more exchanges, each of which reads the images anew; a wide one more work beside the core.
// `reach_gsd`: from the halo's end to where results are used; at least a step is done in each range, however narrow.
std::vector<StepRange> SplitSteps(const std::vector<RefineStep>& steps, int window_px, double reach_gsd);

// Those of a job of so many tiles. One tile needs nobody, and does all at once.
std::vector<StepRange> PartsOf(const JobSettings& settings, size_t tiles);

// How far outside its core a tile reaches, GSD, and the width over which neighbours' results are blended.
double HaloGsd(const MethodSettings& settings);
double BlendGsd(const MethodSettings& settings);

}  // namespace tessera

#endif  // TESSERA_SERVER_PLAN_PARTS_H_
