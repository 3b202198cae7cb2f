// What tasks will take, in core-seconds and bytes of a worker's memory, predicted from the survey alone.
//
// The model is linear in a few quantities of a tile (TileWork), with constants of the program's version that were
// fitted to what workers reported (tests/bench/cost_bench.cc fits them anew and prints the residuals). The tiling rests
// on it, so nothing that workers report at run time may enter.
#ifndef TESSERA_SERVER_PLAN_COST_MODEL_H_
#define TESSERA_SERVER_PLAN_COST_MODEL_H_

#include <cstdint>
#include <vector>

#include "common/tile/ground.h"
#include "common/tile/survey.h"
#include "server/plan/cell_index.h"
#include "server/plan/parts.h"
#include "server/settings/job_settings.h"

namespace tessera {

// How often the refinement looks at its pixels.
struct RefineEffort {
  double evaluations = 0;   // of the data term, in equivalents of full resolution: a level l counts 4^-l
  double iterations = 0;    // steps, on whatever level
  double finest_share = 1;  // pixels of the finest level, as a share of those of full resolution
  double labellings = 0;    // at full resolution
};

// Of all steps of a job's settings, of some steps, of each of some parts of a job's.
RefineEffort EffortOf(const JobSettings& settings);
RefineEffort EffortOf(const std::vector<RefineStep>& steps, const StepRange& range);
std::vector<RefineEffort> EffortsOf(const JobSettings& settings, const std::vector<StepRange>& parts);

// What a tile holds. Faces are those after splitting; pixels those of full resolution.
struct TileWork {
  double core_faces = 0;
  double faces = 0;            // core and halo
  std::vector<int32_t> views;  // those that the tile's cells chose, ascending
  int seeing_views = 0;        // of these, those whose image the tile's boxes meet
  double pixels = 0;           // of all crops to the tile
  double pair_pixels = 0;      // of the references' crops, over all pairs
  double open_pixels = 0;      // most that lie in the crops of views that are open together (PhotoTerm::Evaluate)
  double image_pixels = 0;     // of the whole images that are read for the crops
  double largest_decoded = 0;  // bytes of the largest file as decoded, before its crop is taken
  int likelihood_planes = 0;   // per pixel; 0: the scene has none
  double reach_m = 0;          // how far corners of the core's faces lie outside it
};

// Looks at the cells within `halo_m` of the core, a cell that is partly so by its share, and at where their boxes lie
// in the images.
TileWork MeasureTile(const CellIndex& cells, const CellRect& core, double halo_m);

struct Prediction {
  double core_seconds = 0;
  int64_t peak_bytes = 0;
};

// The tasks of a tile.
Prediction PredictCrop(const TileWork& work);
Prediction PredictRefine(const TileWork& work, const RefineEffort& effort);
// In parts: seconds summed, memory of the hungriest.
Prediction PredictRefine(const TileWork& work, const std::vector<RefineEffort>& parts);
Prediction PredictCut(const Survey& survey, const TileWork& work);
Prediction PredictStitch(const TileWork& work);
// The tasks of the job.
Prediction PredictIngest(const Survey& survey);
Prediction PredictPublish(const Survey& survey);

// A lower bound of what refining so many faces takes, which needs no look at the images.
int64_t LeastRefineBytes(double faces);

// How far off predictions may be: measured / predicted lay within [low, high] for about 90 % of the tasks that the
// constants were fitted to (cost_bench prints it).
struct Interval {
  double low = 1, high = 1;
};
Interval RefineSecondsInterval();
Interval RefineBytesInterval();

}  // namespace tessera

#endif  // TESSERA_SERVER_PLAN_COST_MODEL_H_
