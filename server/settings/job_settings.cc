#include "server/settings/job_settings.h"

#include "absl/strings/str_cat.h"
#include "server/settings/export_settings.h"

namespace tessera {

bool Classifies(const JobSettings& settings) {
  return !settings.classifier.empty() && settings.classifier != kNoClassifier;
}

namespace {

// For messages. The dispatcher compares trained classifiers by content.
std::string KindOfClassifier(const JobSettings& settings) {
  if (!Classifies(settings)) return "none";
  return settings.classifier == kDefaultClassifier ? "the default" : "a trained one";
}

}  // namespace

Status CheckJobSettings(const JobSettings& settings) {
  Faults faults;
  const auto check = [&faults](const char* name, int found, int high, const char* zero) {
    if (found >= 0 && found <= high) return;
    faults.Add(
        absl::InvalidArgumentError(absl::StrCat(name, ": found ", found, ", expected 0 (", zero, ") to ", high)));
  };
  check("tiles", settings.tiles, kMaxTiles, "as many as --tile-memory requires");
  const int64_t memory = settings.tile_memory_bytes;
  if (memory != 0 && (memory < kMinTileMemory || memory > kMaxTileMemory)) {
    faults.Add(absl::InvalidArgumentError(
        absl::StrCat("tile memory: found ", memory,
                     " bytes, expected 0 (4 GiB, or no limit if tiles are set) or 128 MiB to 64 TiB")));
  }
  check("rounds", settings.rounds, kMaxRounds, "the method's default");
  if (settings.method == kLabelsMethod && settings.rounds > 1) {
    faults.Add(absl::InvalidArgumentError(
        absl::StrCat("rounds: found ", settings.rounds, ", expected 1: method labels solves labels once")));
  }
  faults.Add(CheckMethod(settings.method, settings.method_settings));
  if (!(settings.max_core_seconds >= 0)) {
    faults.Add(absl::InvalidArgumentError(
        absl::StrCat("max core-seconds: found ", settings.max_core_seconds, ", expected 0 (no limit) or more")));
  }
  if (Classifies(settings) && settings.classifier != kDefaultClassifier && settings.classifier.front() != '/') {
    faults.Add(absl::InvalidArgumentError(absl::StrCat("classifier: found '", settings.classifier, "', expected '",
                                                       kDefaultClassifier, "', '", kNoClassifier,
                                                       "' or the absolute path of a trained classifier")));
  }
  if (!(settings.skip_images >= 0 && settings.skip_images <= kMaxSkippedShare)) {
    faults.Add(absl::InvalidArgumentError(absl::StrCat("skip images: found ", settings.skip_images,
                                                       ", expected the largest share of images to leave out, 0 to ",
                                                       kMaxSkippedShare)));
  }
  const UpdateSettings& update = settings.update;
  if (!update.base.empty() && (settings.skip_images != 0 || settings.anyway)) {
    faults.Add(absl::InvalidArgumentError(
        "skip images, anyway: found with a base job, expected none: they do not apply to updates. Remove missing and "
        "broken images from the update's camera model"));
  }
  if (update.base.empty() && !(update == UpdateSettings())) {
    faults.Add(absl::InvalidArgumentError(
        "base: found none, expected a base job: withdrawn flights, epochs and from-scratch apply to updates only"));
  }
  UpdateSettings rollback;
  rollback.base = update.base;
  rollback.rollback_to = update.rollback_to;
  rollback.rollback_tiles = update.rollback_tiles;
  if (!(update.rollback_to.empty() ? update.rollback_tiles.empty() : update == rollback)) {
    faults.Add(
        absl::InvalidArgumentError("rollback: found tiles without an earlier job, or other update settings, expected "
                                   "an earlier job and its tiles only"));
  }
  UpdateSettings export_only;
  export_only.base = update.base;
  export_only.export_only = true;
  if (update.export_only && !(update == export_only && !settings.exports.formats.empty())) {
    faults.Add(
        absl::InvalidArgumentError("export: found no formats, or other update settings, expected the formats of the "
                                   "base job's result only"));
  }
  if (!update.rollback_to.empty() && !settings.exports.formats.empty()) {
    faults.Add(absl::InvalidArgumentError(
        "export: found formats in a rollback, expected none: export the result of the rollback when it has ended"));
  }
  for (const std::string& name : settings.exports.formats) {
    const ExportFormat* const format = FindExportFormat(name);
    if (format == nullptr || !format->reads_changes || !update.base.empty()) continue;
    faults.Add(absl::InvalidArgumentError(
        absl::StrCat("formats: found ", name, " without a base job, expected it for updates only")));
  }
  if (!(settings.exports == ExportSettings())) faults.Add(ExportOptionsOf(settings.exports).status());
  return faults.ToStatus();
}

StatusOr<JobSettings> SettingsOfUpdate(const JobSettings& asked, const JobSettings& base) {
  const JobSettings standard;
  Faults faults;
  const auto check = [&](const char* name, const auto& found, const auto& unset, const auto& of_base) {
    if (found == unset || found == of_base) return;
    faults.Add(
        absl::InvalidArgumentError(absl::StrCat(name, ": found another value than ", asked.update.base,
                                                " has, expected none: an update inherits it from its base job")));
  };
  check("tiles", asked.tiles, standard.tiles, base.tiles);
  check("tile memory", asked.tile_memory_bytes, standard.tile_memory_bytes, base.tile_memory_bytes);
  check("rounds", asked.rounds, standard.rounds, base.rounds);
  if (!asked.classifier.empty() && KindOfClassifier(asked) != KindOfClassifier(base)) {
    faults.Add(absl::InvalidArgumentError(absl::StrCat("classifier: found ", KindOfClassifier(asked), ", expected ",
                                                       KindOfClassifier(base), ", as in ", asked.update.base,
                                                       ": an update inherits it from its base job")));
  }
  check("method", asked.method, standard.method, base.method);
  check("method settings", asked.method_settings, standard.method_settings, base.method_settings);
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  JobSettings settings = base;
  settings.skip_images = standard.skip_images;
  settings.anyway = standard.anyway;
  settings.update = asked.update;
  settings.max_core_seconds = asked.max_core_seconds;
  settings.exports = asked.exports;
  return settings;
}

}  // namespace tessera
