#include "server/admission/admission.h"

#include <algorithm>
#include <filesystem>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/admission/field_bounds.h"
#include "server/settings/export_settings.h"
#include "server/settings/settings_proto.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

constexpr size_t kMaxSettingsBytes = 64 << 10;

bool ReadsScene(const Submission& submission) {
  const UpdateSettings& update = submission.settings.update;
  return update.rollback_to.empty() && !update.export_only;
}

// All these fields are stored as long as the job.
Status CheckSizes(const Submission& submission) {
  v1::JobSettings settings;
  ToProto(submission.settings, &settings);
  Faults faults;
  faults.Add(CheckSize("request_id", submission.request_id.size(), kMaxNameBytes));
  faults.Add(CheckSize("display_name", submission.display_name.size(), kMaxNameBytes));
  faults.Add(CheckSize("scene_path", submission.scene_path.size(), kMaxPathBytes));
  faults.Add(CheckSize("settings", settings.ByteSizeLong(), kMaxSettingsBytes));
  return faults.ToStatus();
}

JobRequest RequestOf(const Submission& submission) {
  std::string scene;
  if (ReadsScene(submission)) {
    const std::string& path = submission.scene_path;
    scene = IsS3Url(path) ? path : AbsolutePath(path);
  }
  return {submission.request_id, std::move(scene), submission.settings};
}

// Whether the setting names a file.
bool IsFile(const std::string& classifier) {
  return !classifier.empty() && classifier != kDefaultClassifier && classifier != kNoClassifier;
}

Status NoFilesOverNetwork(const std::string& what) {
  return absl::FailedPreconditionError(
      absl::StrCat(what, " cannot be submitted over the network; start tesserad with --scene-root FOLDER to allow it"));
}

}  // namespace

bool Admission::MayReadFiles(const Submission& submission) const {
  return environment_.scenes_over_network || submission.is_local;
}

StatusOr<JobStatus> Admission::Submit(const Submission& submission, const Cancelled& cancelled) const {
  TESSERA_RETURN_IF_ERROR(CheckSizes(submission));
  TESSERA_ASSIGN_OR_RETURN(std::optional<JobStatus> known, environment_.jobs->FindRequest(RequestOf(submission)));
  if (known) return *std::move(known);
  TESSERA_RETURN_IF_ERROR(environment_.jobs->MayCreateJob(submission.client));
  TESSERA_ASSIGN_OR_RETURN(const NewJob job, MakeJob(submission, cancelled));
  return environment_.jobs->CreateJob(job);
}

StatusOr<JobStatus> Admission::Validate(const Submission& submission, const Cancelled& cancelled) const {
  TESSERA_RETURN_IF_ERROR(CheckSizes(submission));
  TESSERA_ASSIGN_OR_RETURN(NewJob job, MakeJob(submission, cancelled));
  TESSERA_ASSIGN_OR_RETURN(job, environment_.jobs->CompleteJob(std::move(job)));
  JobStatus status;
  status.header.display_name = job.display_name;
  status.header.scene_path = job.scene_path;
  status.header.settings = job.settings;
  status.header.warnings = job.warnings;
  return status;
}

StatusOr<JobQuote> Admission::Quote(const Submission& submission, const Cancelled& cancelled) const {
  TESSERA_RETURN_IF_ERROR(CheckSizes(submission));
  SceneDescription scene;
  TESSERA_ASSIGN_OR_RETURN(NewJob job, MakeJob(submission, cancelled, &scene));
  TESSERA_ASSIGN_OR_RETURN(job, environment_.jobs->CompleteJob(std::move(job)));
  return QuoteOf(job, scene, *environment_.jobs, *environment_.blobs, environment_.scene_files);
}

StatusOr<NewJob> Admission::MakeJob(const Submission& submission, const Cancelled& cancelled,
                                    SceneDescription* scene) const {
  NewJob job;
  job.client = submission.client;
  job.request = RequestOf(submission);
  job.settings = submission.settings;
  job.priority = submission.priority;
  job.display_name = submission.display_name;
  TESSERA_ASSIGN_OR_RETURN(const ClientLimits::Ticket reading, environment_.limits->Transfer(submission.client, {}));
  TESSERA_RETURN_IF_ERROR(CheckJobSettings(job.settings));
  TESSERA_RETURN_IF_ERROR(CheckPriority(job.priority));
  if (ReadsScene(submission)) TESSERA_RETURN_IF_ERROR(AddScene(submission, cancelled, job, scene));
  // A disconnected caller would not learn the job's name.
  if (cancelled && cancelled()) return absl::CancelledError("cancelled: the caller has disconnected");
  return job;
}

StatusOr<SceneListing> Admission::ReadFiles(const Submission& submission, const SceneRequest& request,
                                            const Cancelled& cancelled) const {
  const std::string& path = submission.scene_path;
  if (IsS3Url(path)) {
    if (environment_.stored_scenes == nullptr) {
      return absl::FailedPreconditionError(
          "scenes in an object store cannot be submitted; start tesserad with --scene-root s3://BUCKET/PREFIX to allow "
          "it");
    }
    if (IsFile(request.classifier) && !MayReadFiles(submission)) return NoFilesOverNetwork("a classifier in a file");
    return ReadStoredScene(path, request, environment_.scene_files, *environment_.stored_scenes, cancelled);
  }
  if (!std::filesystem::path(path).is_absolute()) {
    return InputError("scene_path", "", "'" + path + "'", "an absolute path or s3://BUCKET/PREFIX");
  }
  if (!MayReadFiles(submission)) return NoFilesOverNetwork("scenes");
  return environment_.read_scene(path, request, environment_.scene_files);
}

Status Admission::AddScene(const Submission& submission, const Cancelled& cancelled, NewJob& job,
                           SceneDescription* description) const {
  SceneRequest request = {job.settings.update.base.empty(), job.settings.classifier};
  request.skip_images = job.settings.skip_images;
  if (!request.needs_mesh) {
    TESSERA_ASSIGN_OR_RETURN(const JobStatus base, environment_.jobs->GetJob(job.settings.update.base));
    request.base_classifies = Classifies(base.header.settings);
  }
  TESSERA_ASSIGN_OR_RETURN(SceneListing scene, ReadFiles(submission, request, cancelled));
  if (std::binary_search(scene.files.begin(), scene.files.end(), kClassifierFile)) {
    return InputError(scene.folder + "/" + kClassifierFile, "", "a file of this name", "none: it is reserved");
  }
  if (request.needs_mesh) {
    job.settings.classifier = scene.classifier;
    TESSERA_RETURN_IF_ERROR(CheckExports(job.settings, scene.place));
  }
  if (job.display_name.empty()) job.display_name = scene.name;
  job.scene_path = scene.folder;
  job.warnings = scene.warnings;
  if (request.needs_mesh) {  // else those of the base's scene: CompleteJob
    for (std::string& warning : WarningsOfExports(job.settings, scene.place))
      job.warnings.push_back(std::move(warning));
  }
  if (IsS3Url(scene.folder)) {
    job.scene_files = std::move(scene.digests);
  } else {
    TESSERA_ASSIGN_OR_RETURN(job.scene_files, DigestSceneFiles(scene.folder, scene.files, environment_.scene_files,
                                                               *environment_.digests, *environment_.clock, cancelled));
  }
  if (description != nullptr) *description = std::move(scene.scene);
  if (scene.classifier_content.empty()) return absl::OkStatus();
  job.classifier = std::move(scene.classifier_content);
  job.scene_files.push_back(
      {kClassifierFile, {Sha256Hex(job.classifier), static_cast<int64_t>(job.classifier.size())}});
  return absl::OkStatus();
}

}  // namespace tessera
