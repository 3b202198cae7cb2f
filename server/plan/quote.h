// What a job is predicted to take, tile by tile and in all.
#ifndef TESSERA_SERVER_PLAN_QUOTE_H_
#define TESSERA_SERVER_PLAN_QUOTE_H_

#include <cstdint>
#include <set>
#include <vector>

#include "common/base/status.h"
#include "common/job/survey.h"
#include "server/plan/cost_scale.h"
#include "server/settings/job_settings.h"

namespace tessera {

struct TileQuote {
  int tile = 0;
  CellRect core;
  TileWork work;
  Prediction cut, crop;
  Prediction measure, solve, mend;  // of all steps: seconds summed, memory of the hungriest
  Prediction refine;                // of the only tile, in place of these
  double core_seconds() const;
  int64_t peak_bytes() const;    // of its hungriest task
  int64_t stored_bytes() const;  // of all its tasks
};

struct Quote {
  std::vector<TileQuote> tiles;
  Prediction ingest, publish;
  Prediction classify;                     // of all views, where the job makes likelihoods; memory of the hungriest
  double area_m2 = 0;                      // of the ground cells that have faces
  double core_faces = 0, sight_faces = 0;  // summed over tiles: their own, and with what they have in sight
  double core_seconds = 0;                 // of all tasks
  int64_t peak_bytes = 0;                  // of the hungriest task
  int64_t stored_bytes = 0;                // of all tasks
  // About 90 % of tasks took between these shares of what was predicted for them, each task's on its own: the residuals
  // of the model's fit, on machines of one kind with other work on them. What makes a task differ (the machine, its
  // load, how textured the scene is) is much the same for all tasks of a job, so they do not average out, and the sum's
  // interval is taken to be as wide as a task's.
  Interval interval;
};

// The likelihoods of these views, where the job makes them (else nothing); memory of the hungriest.
Prediction PredictViews(const Survey& survey, const std::set<int32_t>& views, const CostScale& costs);

// The same tiles as PlanTiles gives for these settings, corrected by `costs`. Errors as its.
StatusOr<Quote> MakeQuote(const JobSettings& settings, const Survey& survey, const CostScale& costs = {});

// Seconds until the job is done by so many workers of `threads` cores each: stage after stage, in each the longest task
// first to whoever is free, threads without loss.
double WallSeconds(const Quote& quote, int workers, int threads);

// INVALID_ARGUMENT with what to do if the job is predicted to take more than it may.
Status CheckLimit(const JobSettings& settings, double core_seconds);
Status CheckQuote(const JobSettings& settings, const Survey& survey);

}  // namespace tessera

#endif  // TESSERA_SERVER_PLAN_QUOTE_H_
