#include "server/jobs/complete_job.h"

#include <algorithm>
#include <mutex>
#include <optional>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "server/jobs/planner.h"
#include "server/ledger/base_of.h"
#include "server/plan/rollback.h"
#include "server/settings/export_settings.h"

namespace tessera {
namespace {

StatusOr<NewJob> CompleteRollback(DispatchCore& core, Recovery& recovery, NewJob job) {
  UpdateSettings& update = job.settings.update;
  std::vector<UpdateBase> chain;
  {
    std::lock_guard lock(core.mutex());
    TESSERA_ASSIGN_OR_RETURN(chain, ChainTo(core.ledger(), update.base, update.rollback_to));
    TESSERA_ASSIGN_OR_RETURN(const int index, core.ledger().FindJob(update.base));
    const JobHeader& base = core.ledger().jobs()[index].header;
    TESSERA_ASSIGN_OR_RETURN(job.settings, SettingsOfUpdate(job.settings, base.settings));
    job.scene_path = base.scene_path;
    job.scene_files = chain.front().scene_files;
    job.warnings = base.warnings;
    if (job.display_name.empty()) job.display_name = base.display_name;
  }
  TESSERA_ASSIGN_OR_RETURN(const std::string json, recovery.ReadSurveyOf(chain.front()));
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(json));
  TESSERA_ASSIGN_OR_RETURN(update.rollback_tiles, TilesToRollBack(chain, survey, update.rollback_tiles));
  return job;
}

// With the base's scene, whose photographs the export may read.
StatusOr<NewJob> CompleteExport(DispatchCore& core, NewJob job) {
  std::lock_guard lock(core.mutex());
  TESSERA_ASSIGN_OR_RETURN(const UpdateBase base, BaseOf(core.ledger(), job.settings.update));
  TESSERA_ASSIGN_OR_RETURN(const int index, core.ledger().FindJob(base.name));
  const JobHeader& header = core.ledger().jobs()[index].header;
  TESSERA_ASSIGN_OR_RETURN(job.settings, SettingsOfUpdate(job.settings, header.settings));
  job.scene_path = header.scene_path;
  job.scene_files = base.scene_files;
  if (job.display_name.empty()) job.display_name = header.display_name;
  return job;
}

// Whether the exports of a job with a base are possible; returns their warnings. Reads the base's survey, which has the
// scene's place.
StatusOr<Warnings> CheckExportsOfBase(DispatchCore& core, Recovery& recovery, const JobSettings& settings) {
  if (settings.exports.formats.empty()) return Warnings();
  UpdateBase base;
  {
    std::lock_guard lock(core.mutex());
    TESSERA_ASSIGN_OR_RETURN(base, BaseOf(core.ledger(), settings.update));
  }
  const bool has_changes = !settings.update.export_only || base.changes;  // an update makes them
  for (const std::string& name : settings.exports.formats) {
    const ExportFormat* const format = FindExportFormat(name);
    if (format == nullptr || !format->reads_changes || has_changes) continue;
    return absl::InvalidArgumentError(absl::StrCat("formats: found ", name, " for ", base.name, ", which has no ",
                                                   kChangesGeoJsonFile, ", expected an update with a new flight"));
  }
  TESSERA_ASSIGN_OR_RETURN(const std::string json, recovery.ReadSurveyOf(base));
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(json));
  TESSERA_RETURN_IF_ERROR(CheckExports(settings, survey));
  TESSERA_ASSIGN_OR_RETURN(const ExportScene scene, ExportSceneOf(survey));
  return WarningsOfExports(settings, scene);
}

StatusOr<NewJob> CompleteByKind(DispatchCore& core, Recovery& recovery, NewJob job) {
  if (!job.settings.update.rollback_to.empty()) return CompleteRollback(core, recovery, std::move(job));
  if (job.settings.update.export_only) return CompleteExport(core, std::move(job));
  for (const NamedDigest& file : job.scene_files) {
    if (!IsCarried(file.name)) continue;
    return InputError(job.scene_path + "/" + file.name, "", "a file in a folder of this name", "none: it is reserved");
  }
  if (!job.settings.update.base.empty()) {
    std::lock_guard lock(core.mutex());
    TESSERA_ASSIGN_OR_RETURN(const UpdateBase base, BaseOf(core.ledger(), job.settings.update.base));
    TESSERA_ASSIGN_OR_RETURN(const int index, core.ledger().FindJob(base.name));
    TESSERA_ASSIGN_OR_RETURN(job.settings, SettingsOfUpdate(job.settings, core.ledger().jobs()[index].header.settings));
    std::set<std::string> contents;
    std::optional<Digest> given;  // the classifier
    for (const NamedDigest& file : job.scene_files) {
      contents.insert(file.digest.sha256);
      if (file.name == kClassifierFile) given = file.digest;
    }
    for (const NamedDigest& file : base.scene_files) {
      if (file.name == kClassifierFile) {
        if (given && *given != file.digest) {
          return InputError("classifier", "", "sha256 " + given->sha256,
                            file.digest.sha256 + ", that of " + base.name + ": an update keeps that of its base");
        }
        if (!given) job.scene_files.push_back(file);
        continue;
      }
      if (contents.insert(file.digest.sha256).second) job.scene_files.push_back({CarriedName(file), file.digest});
    }
  }
  std::vector<std::string> names;
  for (const NamedDigest& file : job.scene_files) names.push_back(file.name);
  std::sort(names.begin(), names.end());
  TESSERA_RETURN_IF_ERROR(core.environment().planner->Ingest(job.settings, names, {}).status());
  return job;
}

}  // namespace

StatusOr<NewJob> CompleteJob(DispatchCore& core, Recovery& recovery, NewJob job) {
  if (job.settings.update.base.empty()) return CompleteByKind(core, recovery, std::move(job));
  TESSERA_ASSIGN_OR_RETURN(Warnings warnings, CheckExportsOfBase(core, recovery, job.settings));
  TESSERA_ASSIGN_OR_RETURN(job, CompleteByKind(core, recovery, std::move(job)));
  for (std::string& warning : warnings) {
    const bool is_known = std::find(job.warnings.begin(), job.warnings.end(), warning) != job.warnings.end();
    if (!is_known) job.warnings.push_back(std::move(warning));
  }
  return job;
}

}  // namespace tessera
