// Admission of jobs: from a submission to a created job, for every way to submit one (gRPC, a page).
#pragma once

#include <string>
#include <utility>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/storage/allowed_files.h"
#include "common/storage/blob_store.h"
#include "server/admission/job_quote.h"
#include "server/admission/scene_files.h"
#include "server/admission/scene_reader.h"
#include "server/auth/client_limits.h"
#include "server/jobs/jobs.h"
#include "server/settings/job_settings.h"
#include "server/store/record_store.h"

namespace tessera {

// A request to create a job.
struct Submission {
  std::string request_id;    // submissions with the same id create one job; empty: always a new job
  std::string scene_path;    // absolute, or s3://BUCKET/PREFIX; a rollback and an export use the base's scene
  std::string display_name;  // empty: the scene's name
  JobSettings settings;      // settings.update.base: the base job
  int priority = 0;
  std::string client;     // the caller, for limits and the job's header
  bool is_local = false;  // the caller used a Unix socket
};

// All must outlive the admission.
struct AdmissionEnvironment {
  Jobs* jobs = nullptr;
  ClientLimits* limits = nullptr;
  DigestCache* digests = nullptr;
  const Clock* clock = nullptr;
  SceneReader read_scene = ReadScene;
  AllowedFiles scene_files = AllowedFiles::All();  // files that scenes may have
  bool scenes_over_network = true;                 // false: only local callers may submit a scene in a folder
  const StoredScenes* stored_scenes = nullptr;     // null: no scene in an object store
  const BlobStore* blobs = nullptr;                // for Quote
};

// Validates a submission, reads its scene, hashes the scene's files and creates the job. Thread-safe: submissions are
// read side by side, each counts as a transfer of its client (ClientLimits).
//
// INVALID_ARGUMENT lists all faults of the step that failed: fields, settings, scene.
// FAILED_PRECONDITION: the scene may not be read over the network, or a file changed while it was read. NOT_FOUND: no
// such base job or classifier. ALREADY_EXISTS: the id was used for another submission. RESOURCE_EXHAUSTED: a limit of
// the client. UNAVAILABLE: the coordinator drains, or recomputes lost results of the base. CANCELLED: by `cancelled`.
class Admission {
 public:
  explicit Admission(AdmissionEnvironment environment) : environment_(std::move(environment)) {}

  // Creates the job. Reads nothing if the id has a job or the client has reached its limit of jobs.
  StatusOr<JobStatus> Submit(const Submission& submission, const Cancelled& cancelled = {}) const;
  // All checks of Submit except those of the id and the number of jobs. Creates nothing; of the result, only the
  // header's display name, scene path, settings and warnings are set.
  StatusOr<JobStatus> Validate(const Submission& submission, const Cancelled& cancelled = {}) const;
  // The predicted cost of a submission that Validate accepts; else its error. Reads poses, headers and a sample of the
  // mesh, no pixels.
  StatusOr<JobQuote> Quote(const Submission& submission, const Cancelled& cancelled = {}) const;

 private:
  // The job of a submission whose fields were checked. Reads and hashes the scene.
  // `scene`: gets the description of its scene; may be null.
  StatusOr<NewJob> MakeJob(const Submission& submission, const Cancelled& cancelled,
                           SceneDescription* scene = nullptr) const;
  Status AddScene(const Submission& submission, const Cancelled& cancelled, NewJob& job,
                  SceneDescription* description) const;
  // Whether the caller may name files of the coordinator's machine.
  bool MayReadFiles(const Submission& submission) const;
  // The files of the submission's scene. FAILED_PRECONDITION if it may not be read.
  StatusOr<SceneListing> ReadFiles(const Submission& submission, const SceneRequest& request,
                                   const Cancelled& cancelled) const;

  const AdmissionEnvironment environment_;
};

}  // namespace tessera
