// The predicted cost of a submission, before a job is created.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/scene/scene.h"
#include "common/storage/allowed_files.h"
#include "common/storage/blob_store.h"
#include "server/jobs/jobs.h"
#include "server/tiling/cost_model.h"

namespace tessera {

// Figures that are not known are not set.
struct JobQuote {
  JobSettings settings;  // as the job would have them
  Warnings warnings;     // those of the submission, and why planning would refuse it
  int images = 0;
  double pixels = 0;        // of all images
  int64_t mesh_faces = -1;  // -1: the header of the mesh's file does not declare it
  std::string surveyed_by;  // the job whose survey gives the figures below; empty: they are estimates, or not known
  std::optional<Interval> tiles, core_seconds, peak_bytes, stored_bytes, area_m2;
  double gsd_m = 0;                    // 0: not known
  std::vector<std::string> estimated;  // names of the set members that are estimates
  std::string basis;                   // what the figures were computed from, for people
};

// The quote of `job`, which CompleteJob gave. From the survey of a job of the same scene that is stored (`blobs`), or
// estimated from the poses in `scene` and a sample of its mesh. `scene`: of `job`; without views for an update, a
// rollback or an export, whose cost is not predicted here. Errors of the blob store; those of reading the mesh's sample
// become warnings.
StatusOr<JobQuote> QuoteOf(const NewJob& job, const SceneDescription& scene, const Jobs& jobs, const BlobStore& blobs,
                           const AllowedFiles& allowed);

}  // namespace tessera
