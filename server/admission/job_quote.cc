#include "server/admission/job_quote.h"

#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/s3/s3_location.h"
#include "common/scene/mesh_sample.h"
#include "server/tiling/quote.h"
#include "server/tiling/rough_quote.h"

namespace tessera {
namespace {

Interval Exactly(double value) { return {value, value}; }

Interval Scaled(const Interval& interval, double value) { return {interval.low * value, interval.high * value}; }

void Warn(const Status& status, JobQuote* quote) {
  if (!status.ok()) quote->warnings.push_back(std::string(status.message()));
}

// As `tessera plan` with the same survey.
Status FillFromSurvey(const Survey& survey, JobQuote* quote) {
  Warn(CheckPairs(quote->settings, survey), quote);
  TESSERA_ASSIGN_OR_RETURN(const Quote predicted, MakeQuote(quote->settings, survey));
  Warn(CheckLimit(quote->settings, predicted.core_seconds), quote);
  quote->tiles = Exactly(static_cast<double>(predicted.tiles.size()));
  quote->core_seconds = Scaled(predicted.interval, predicted.core_seconds);
  quote->peak_bytes = Scaled(kRefineBytesInterval, static_cast<double>(predicted.peak_bytes));
  quote->stored_bytes = Scaled(kStoredBytesInterval, static_cast<double>(predicted.stored_bytes));
  quote->area_m2 = Exactly(predicted.area_m2);
  quote->gsd_m = survey.gsd_m;
  quote->estimated = {"core_seconds", "peak_bytes", "stored_bytes"};
  quote->basis = absl::StrCat("the survey of ", quote->surveyed_by, ", which has the same scene");
  return absl::OkStatus();
}

Status FillRoughly(const SceneDescription& scene, const MeshSample& sample, JobQuote* quote) {
  TESSERA_ASSIGN_OR_RETURN(const RoughQuote rough, MakeRoughQuote(quote->settings, scene, sample));
  quote->tiles = rough.tiles;
  quote->core_seconds = rough.core_seconds;
  quote->peak_bytes = rough.peak_bytes;
  quote->stored_bytes = rough.stored_bytes;
  quote->area_m2 = rough.area_m2;
  quote->gsd_m = rough.gsd_m;
  quote->estimated = {"tiles", "core_seconds", "peak_bytes", "stored_bytes", "area_m2", "gsd_m"};
  if (rough.tiles.low == rough.tiles.high) quote->estimated.erase(quote->estimated.begin());
  quote->basis = absl::StrCat("the poses of the images and ", sample.mesh.faces.size(), " of the ", sample.faces,
                              " faces of the start mesh");
  if (rough.share < 1) absl::StrAppendFormat(&quote->basis, ", on %.0f %% of the area", 100 * rough.share);
  if (const double most = quote->settings.max_core_seconds; most > 0 && rough.core_seconds.low > most) {
    Warn(CheckLimit(quote->settings, rough.core_seconds.low), quote);
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<JobQuote> QuoteOf(const NewJob& job, const SceneDescription& scene, const Jobs& jobs, const BlobStore& blobs,
                           const AllowedFiles& allowed) {
  JobQuote quote;
  quote.settings = job.settings;
  quote.warnings = job.warnings;
  quote.images = static_cast<int>(scene.views.size());
  for (const SceneView& view : scene.views) {
    quote.pixels += static_cast<double>(view.lens.pinhole.width) * view.lens.pinhole.height;
  }
  if (!job.settings.update.base.empty()) {
    quote.basis = "nothing: the cost of a job with a base is known when it is planned (plan_only)";
    return quote;
  }
  // The header and the sample. Faults of the mesh are those of ingest; here they are warnings.
  MeshSample sample;
  sample.faces = -1;
  if (IsS3Url(job.scene_path)) {
    quote.basis = "nothing: the mesh is in an object store";
  } else if (StatusOr<MeshSample> read = SampleSceneMesh(scene, allowed); read.ok()) {
    sample = *std::move(read);
    quote.basis = "nothing: a mesh of this format must be read from its start";
  } else {
    Warn(read.status(), &quote);
    quote.basis = "nothing: the mesh cannot be read";
  }
  quote.mesh_faces = sample.faces;
  if (const std::optional<KnownSurvey> known = jobs.FindSurvey(job)) {
    const StatusOr<std::string> json = blobs.Read(known->survey);
    if (!json.ok() && !absl::IsNotFound(json.status())) return json.status();
    const StatusOr<Survey> survey = json.ok() ? ParseSurvey(*json) : json.status();
    if (survey.ok()) {  // else it is lost or damaged
      quote.surveyed_by = known->job;
      Warn(FillFromSurvey(*survey, &quote), &quote);
      return quote;
    }
  }
  if (!sample.mesh.faces.empty()) Warn(FillRoughly(scene, sample, &quote), &quote);
  return quote;
}

}  // namespace tessera
