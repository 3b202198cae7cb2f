// What tasks will take, in core-seconds, bytes of a worker's memory and bytes stored, predicted from the survey alone.
//
// The model is linear in a few quantities of a tile (TileWork), with constants of the program's version that were
// fitted to what workers reported (tests/bench/cost_bench.cc fits them anew and prints the residuals). The tiling rests
// on it, so nothing that workers report at run time may enter.
#ifndef TESSERA_SERVER_PLAN_COST_MODEL_H_
#define TESSERA_SERVER_PLAN_COST_MODEL_H_

#include <algorithm>
#include <cstdint>
#include <vector>

#include "common/job/ground.h"
#include "common/job/refine_steps.h"
#include "common/job/survey.h"
#include "server/plan/cell_index.h"
#include "server/settings/job_settings.h"

namespace tessera {

// What some steps of a refinement do.
struct RefineEffort {
  double evaluations = 0;   // of the data term, in equivalents of full resolution: a level l counts 4^-l
  double iterations = 0;    // steps, on whatever level
  double widths = 0;        // of the images that steps compare: a level l counts 2^-l
  double finest_share = 0;  // pixels of the finest level, as a share of those of full resolution
  double labellings = 0;    // at full resolution
  double mends = 0;         // repairs of folds
};

// Of one step; of some, by their indices; of all that a job does.
RefineEffort EffortOf(const RefineStep& step);
RefineEffort EffortOf(const std::vector<RefineStep>& steps, const std::vector<int>& which);
RefineEffort EffortOf(const JobSettings& settings, const Survey& survey);

// How far outside its core a tile's tasks are expected to read: what its views see, whose motion they need; what a step
// of the solver reaches; windows about the core's own pixels. What they do read cut finds on the mesh.
inline constexpr double kSightGsd = 220, kSolveGsd = 160, kApronGsd = 32;

// What a tile holds. Faces are those after splitting; pixels those of full resolution, of the core and its apron.
struct TileWork {
  double core_faces = 0;
  double solve_faces = 0;      // of the core and kSolveGsd around it
  double sight_faces = 0;      // of the core and kSightGsd around it
  std::vector<int32_t> views;  // those that the tile's cells chose, ascending
  int seeing_views = 0;        // of these, those whose image the tile's boxes meet
  double pixels = 0;           // of all crops to the tile
  double pair_pixels = 0;      // over all pairs, where the reference shows the cells of the core that chose it
  double drawn_faces = 0;      // over all views, of the cells that they are drawn for: PhotoTerm::FindWork
  double open_pixels = 0;      // most that lie in the crops of views that are open together (PhotoTerm::Evaluate)
  double largest_crop = 0;     // of them, pixels
  double image_pixels = 0;     // of the whole images that are read for the crops
  double largest_decoded = 0;  // bytes of the largest file as decoded, before its crop is taken
  int likelihood_planes = 0;   // per pixel; 0: the scene has none
};

// Looks at the cells that near the core, a cell that is partly so by its share, and at where their boxes lie in the
// images.
TileWork MeasureTile(const CellIndex& cells, const CellRect& core);

struct Prediction {
  double core_seconds = 0;
  int64_t peak_bytes = 0;
  int64_t stored_bytes = 0;  // of what it makes, which stays in the blob store
  // Of several tasks: memory of the hungriest.
  Prediction& operator+=(const Prediction& other) {
    core_seconds += other.core_seconds;
    peak_bytes = std::max(peak_bytes, other.peak_bytes);
    stored_bytes += other.stored_bytes;
    return *this;
  }
};

// The tasks of a tile. Those of several steps: seconds and what is stored summed, memory of the hungriest.
Prediction PredictCut(const Survey& survey, const TileWork& work);
Prediction PredictCrop(const TileWork& work);
Prediction PredictMeasure(const TileWork& work, const RefineEffort& effort);
Prediction PredictSolve(const TileWork& work, const RefineEffort& effort);
Prediction PredictMend(const TileWork& work, const RefineEffort& effort);
// All steps of the only tile in one task.
Prediction PredictRefine(const TileWork& work, const RefineEffort& effort);
// The tasks of the job.
Prediction PredictIngest(const Survey& survey);
Prediction PredictPublish(const Survey& survey);
// The likelihoods of each view, where the job makes them.
std::vector<Prediction> PredictClassify(const Survey& survey);
// Of an update: a block of ground of which new images, of so many pixels, see so many change cells; the report of so
// many blocks.
Prediction PredictCompare(const Survey& survey, double image_pixels, double cells);
Prediction PredictChanges(const Survey& survey, double blocks);

// A lower bound of what a tile with so many faces takes, which needs no look at the images.
int64_t LeastTileBytes(double faces);

// How far off predictions may be: measured / predicted lay within [low, high] for about 90 % of the tasks that the
// constants were fitted to (cost_bench prints it).
struct Interval {
  double low = 1, high = 1;
};
Interval RefineSecondsInterval();
Interval RefineBytesInterval();
Interval StoredBytesInterval();

}  // namespace tessera

#endif  // TESSERA_SERVER_PLAN_COST_MODEL_H_
