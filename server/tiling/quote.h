// Predicted cost of a job, per tile and in total. All functions are thread-safe.
#pragma once

#include <cstdint>
#include <set>
#include <vector>

#include "common/base/status.h"
#include "common/job/survey.h"
#include "server/settings/job_settings.h"
#include "server/tiling/cost_scale.h"

namespace tessera {

struct TileQuote {
  int tile = 0;
  CellRect core;
  TileWork work;
  // Of both parts of a job that splits faces twice: cut, with the start of the second part; the share of its group's
  // crop (CropGroup), and the first tile of this group.
  Prediction cut, crop;
  int crop_group = 0;
  Prediction measure, solve, mend;  // of all steps: sums, but the largest memory
  Prediction refine;                // of an untiled job, instead of these
  Prediction Total() const;
};

// The sums are of all tasks, the memory is the largest.
struct Quote : Prediction {
  std::vector<TileQuote> tiles;
  Prediction ingest, publish;
  Prediction split;                          // the second split of faces; zero if the job splits them once
  Prediction classify;                       // of all views, if the job classifies; largest memory
  Prediction exports;                        // of all exports; largest memory
  double area_m2 = 0;                        // of the ground cells with faces
  double core_faces = 0, visible_faces = 0;  // summed over tiles: core faces, and faces of the visible sets
  // Prediction interval of a single task (90 % of the residuals of the model's fit), also used for the total. Errors do
  // not average out over the tasks of a job, because their causes (machine, load, texture of the scene) are common to
  // all of them.
  Interval interval;
};

// Classification of these views; zero if the job does not classify. Largest memory.
Prediction PredictViews(const Survey& survey, const std::set<int32_t>& views, const CostScale& costs);

// Predictions for the tiles that PlanTiles gives for these settings, corrected by `costs`. Errors as PlanTiles.
StatusOr<Quote> MakeQuote(const JobSettings& settings, const Survey& survey, const CostScale& costs = {});

// Predicted duration with `workers` workers of `threads` cores each, seconds: stages one after another, list scheduling
// with the longest task first in each stage, linear speedup with threads.
double WallSeconds(const Quote& quote, int workers, int threads);

// INVALID_ARGUMENT if the job refines geometry, but no two images show the same surface.
Status CheckPairs(const JobSettings& settings, const Survey& survey);
// INVALID_ARGUMENT with advice if the predicted cost exceeds the job's limit.
Status CheckLimit(const JobSettings& settings, double core_seconds);
// Both tests.
Status CheckQuote(const JobSettings& settings, const Survey& survey);

}  // namespace tessera
