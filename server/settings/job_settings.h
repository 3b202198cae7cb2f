// Settings of a job, as the user requests them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/job/method_settings.h"

namespace tessera {

inline constexpr int kMaxTiles = 100000;
inline constexpr int kMaxRounds = 20;
inline constexpr double kMaxSkippedShare = 0.9;
inline constexpr int64_t kMinTileMemory = int64_t{128} << 20, kMaxTileMemory = int64_t{64} << 40;

// Settings of an update: a job that refines only what changed since its base job and inherits everything else. Tiles,
// method and method settings are those of the base job.
struct UpdateSettings {
  std::string base;                   // base job, "jobs/J"; empty: no update
  std::vector<std::string> withdraw;  // flights of the base job whose images are no longer used
  // false: where the newest flight covers a cell well enough, older images of it are left out. true: use all images.
  bool all_epochs = false;
  // true: changed tiles and all tiles that depend on them are refined from the start mesh, so the result equals a job
  // on all images. false: changed tiles are refined from the base job's result, and all other tiles keep their bytes.
  bool from_scratch = false;
  bool plan_only = false;  // publish only the plan (kUpdateFile)
  // "jobs/J", an ancestor of `base`: restores `rollback_tiles` from it, takes the other tiles from `base`, and refines
  // none. Empty: no rollback. No tiles: all that differ.
  std::string rollback_to;
  std::vector<int> rollback_tiles;
  bool export_only = false;  // exports the result of `base`, which may be partial, and refines nothing
  bool operator==(const UpdateSettings&) const = default;
};

// Exports of the result. ExportOptionsOf (export_settings.h) checks and converts them.
struct ExportSettings {
  std::vector<std::string> formats;  // none: no export
  std::string crs;
  std::string color;  // empty: "class"
  double gsd_m = 0;
  bool class_materials = false;
  bool operator==(const ExportSettings&) const = default;
};

inline constexpr char kDefaultClassifier[] = "default", kNoClassifier[] = "none";

// Each setting is part of the parameters, and so of the keys, of the tasks that it affects.
struct JobSettings {
  int tiles = 0;  // 0: as many as tile_memory_bytes requires; 1: untiled
  // Largest memory of a worker for one tile; 0: 4 GiB, or no limit if `tiles` is set.
  int64_t tile_memory_bytes = 0;
  int rounds = 0;  // of geometry and labels; 0: the method's default
  std::string method = "tessera";
  MethodSettings method_settings = {};
  // Source of the likelihoods, if not the scene's: the absolute path of a file that `tessera classify --save-model`
  // wrote, or kDefaultClassifier. kNoClassifier: the scene's. Empty: kDefaultClassifier if the scene has neither
  // likelihoods nor labels, else the scene's; admission replaces it by its choice.
  std::string classifier = {};
  UpdateSettings update = {};
  double max_core_seconds = 0;  // a job with a higher predicted cost is refused; 0: no limit
  // Of the scene (SceneLoadOptions); not of updates, which continue a scene that was accepted.
  double skip_images = 0;
  bool anyway = false;
  ExportSettings exports = {};  // an update does not inherit them from its base
};

// Whether the job computes likelihoods itself.
bool Classifies(const JobSettings& settings);

// INVALID_ARGUMENT with one line per fault: the found and the expected value.
Status CheckJobSettings(const JobSettings& settings);

// Settings of an update, completed from those of its base job. INVALID_ARGUMENT if `asked` sets one that an update must
// inherit to another value.
StatusOr<JobSettings> SettingsOfUpdate(const JobSettings& asked, const JobSettings& base);

}  // namespace tessera
