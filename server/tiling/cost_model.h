// Cost model: predicts core-seconds, peak memory and stored bytes of tasks from the survey alone.
//
// The model is linear in a few quantities of a tile (TileWork). Its constants belong to the program's version and were
// fitted to reported usage (tests/bench/cost_bench.cc refits them and prints the residuals). The tiling depends on the
// model, so nothing that workers report at run time may enter it.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "common/job/ground.h"
#include "common/job/refine_steps.h"
#include "common/job/survey.h"
#include "server/settings/job_settings.h"
#include "server/tiling/cell_index.h"

namespace tessera {

// Amount of work of some refinement steps.
struct RefineEffort {
  double evaluations = 0;   // evaluations of the data term; one at level l counts 4^-l
  double warps = 0;         // evaluations of all pairs in both directions; one at level l counts 4^-l
  double iterations = 0;    // iterations at any level
  double widths = 0;        // relative image widths, summed: level l counts 2^-l
  double finest_share = 0;  // of iterations: pixels of the finest level / pixels at full resolution
  double labellings = 0;    // label solves at full resolution
  double mends = 0;         // fold repairs
};

// Effort of one step, and of the steps with given indices.
RefineEffort EffortOf(const RefineStep& step);
RefineEffort EffortOf(const std::vector<RefineStep>& steps, const std::vector<int>& which);

// Effort of a whole job: of its coarse part (none if it has one part), and of the fine part or all of it.
struct JobEffort {
  RefineEffort coarse, fine;
  double coarse_faces = 1;  // faces of the coarse part for each face of the fine part
  bool has_parts() const { return coarse.iterations > 0; }
};
// The survey as it is predicted to be after the second split; the same if the job has one part.
Survey AfterSecondSplit(Survey survey, const JobEffort& effort);
// `survey`: before the second split.
JobEffort EffortOf(const JobSettings& settings, const Survey& survey);

// Index of the first step of the fine part; 0: the job has one part.
int FirstFineStepOf(const JobSettings& settings);
// The steps of a job, and the indices of the active ones of a job that does not start from a base job's states.
std::vector<RefineStep> StepsOf(const JobSettings& settings);
std::vector<int> ActiveStepsOf(const JobSettings& settings, const Survey& survey);

// Expected dependency radii around a tile's core in GSD: visible set; solver step; image windows. The cut task
// determines the exact ones on the mesh.
// And of all that the package has: the repair and the visible set reach farthest. In the fine part of a job (JobPart)
// vertices move less, so that its packages reach less far.
inline constexpr double kVisibleSetGsd = 220, kSolveGsd = 160, kApronGsd = 32, kPackageGsd = 640, kFinePackageGsd = 420;

// Quantities of a tile. Faces: after splitting. Pixels: at full resolution, of the core and its apron.
struct TileWork {
  double core_faces = 0;
  double solve_faces = 0;      // of the core and kSolveGsd around it
  double visible_faces = 0;    // of the core and kVisibleSetGsd around it
  double package_faces = 0;    // of the core and kPackageGsd around it
  double fine_package_faces = 0;  // of the core and kFinePackageGsd around it
  std::vector<int32_t> views;  // views that the tile's cells chose, ascending
  int seeing_views = 0;        // number of these whose image contains a part of the tile
  double pixels = 0;           // of all crops of the tile
  double pair_pixels = 0;      // summed over all pairs: pixels of the reference that show core cells that chose it
  double drawn_faces = 0;      // summed over all views: faces of the cells that are rendered (PhotoTerm::FindWork)
  double open_pixels = 0;      // largest number of crop pixels that are in memory at once (PhotoTerm::Evaluate)
  double largest_crop = 0;     // pixels of the largest crop
  double image_pixels = 0;     // of the whole images of the crops
  double largest_decoded = 0;  // bytes of the largest decoded file, before cropping
  int likelihood_planes = 0;   // per pixel; 0: the scene has no likelihoods
};

// Computes the quantities from the cells in and near the core (partial cells by their share) and the projections of
// their boxes.
TileWork MeasureTile(const CellIndex& cells, const CellRect& core);

// The same tile with this many faces for each of its faces.
TileWork WithFaces(TileWork work, double share);
// The same tile with its package in the fine part of a job.
TileWork InFinePart(TileWork work);

struct Prediction {
  double core_seconds = 0;
  int64_t peak_bytes = 0;
  int64_t stored_bytes = 0;  // outputs, in the blob store
  // Of several tasks: sums, but the largest memory.
  Prediction& operator+=(const Prediction& other) {
    core_seconds += other.core_seconds;
    peak_bytes = std::max(peak_bytes, other.peak_bytes);
    stored_bytes += other.stored_bytes;
    return *this;
  }
};

// Predictions for the tasks of a tile. Of several steps: sums, but the largest memory.
Prediction PredictCut(const Survey& survey, const TileWork& work);
Prediction PredictCrop(const TileWork& work);
// In the fine part of a job (JobPart), in which the crops of the coarse part nearly always hold all windows.
Prediction PredictFineCrop(const TileWork& work);
Prediction PredictMeasure(const TileWork& work, const RefineEffort& effort);
Prediction PredictSolve(const TileWork& work, const RefineEffort& effort);
Prediction PredictMend(const TileWork& work, const RefineEffort& effort);
// The task that runs all steps of an untiled job.
Prediction PredictRefine(const TileWork& work, const RefineEffort& effort);
// The sum of both parts. `work`: with the faces of the fine part.
template <class Predict>
Prediction OfParts(const Predict& predict, const TileWork& work, const JobEffort& effort) {
  if (!effort.has_parts()) return predict(work, effort.fine);
  Prediction sum = predict(InFinePart(work), effort.fine);
  sum += predict(WithFaces(work, effort.coarse_faces), effort.coarse);
  return sum;
}

// Predictions for the tasks of the job; of ingest with the inspections of its images.
Prediction PredictIngest(const Survey& survey);
// The second split; faces of the survey before and after. The states of a tile with which the fine part begins.
Prediction PredictSplit(double faces, double fine_faces);
Prediction PredictStart(const Survey& survey, const TileWork& work);
Prediction PredictPublish(const Survey& survey);
// Classification of one view.
std::vector<Prediction> PredictClassify(const Survey& survey);
// Change detection of an update: one block of `cells` seen by new images of `pixels`, and the report over all blocks.
Prediction PredictCompare(const Survey& survey, double image_pixels, double cells);
Prediction PredictChanges(const Survey& survey, double blocks);

// Lower bound of the memory of a tile with this number of faces, without its views.
int64_t LeastTileBytes(double faces);

// Prediction interval: measured / predicted was within [low, high] for about 90 % of the tasks that the constants were
// fitted to (cost_bench prints it).
struct Interval {
  double low = 1, high = 1;
};
inline constexpr Interval kRefineSecondsInterval = {0.7, 1.5}, kRefineBytesInterval = {0.8, 1.15},
                          kStoredBytesInterval = {0.85, 1.15};

}  // namespace tessera
