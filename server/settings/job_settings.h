// What a user asks of a job.
#ifndef TESSERA_SERVER_SETTINGS_JOB_SETTINGS_H_
#define TESSERA_SERVER_SETTINGS_JOB_SETTINGS_H_

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/job/method_settings.h"

namespace tessera {

inline constexpr int kMaxTiles = 100000;
inline constexpr int kMaxRounds = 20;
inline constexpr int64_t kMinTileMemory = int64_t{128} << 20, kMaxTileMemory = int64_t{64} << 40;

// A job that goes on from the result of an earlier one: what images and cameras changed since is done anew, all else is
// taken over. Tiles, method and its settings are the base's.
struct UpdateSettings {
  std::string base;                   // "jobs/J"; empty: the job stands for itself
  std::vector<std::string> withdraw;  // names of flights of the base whose images are not used any more
  // false: where the newest flight sees a cell well enough, older images of it are left out; true: all as one scene.
  bool all_epochs = false;
  // Changed tiles begin at the start mesh and others follow as far as the steps reach, as in a job on all images; else
  // they begin at the base's result, and all other tiles stay as they are, to the byte.
  bool from_scratch = false;
  bool plan_only = false;  // ends with the plan (kUpdateFile)
  // "jobs/J", one that `base` goes on from: takes these tiles from there, the others from `base`, and refines none.
  // Empty: nothing is taken back. No tiles: all that differ.
  std::string rollback_to;
  std::vector<int> rollback_tiles;
  bool operator==(const UpdateSettings&) const = default;
};

inline constexpr char kDefaultClassifier[] = "default", kNoClassifier[] = "none";

// Everything in it enters the tasks' parameters, and so their keys, as far as it concerns them.
struct JobSettings {
  int tiles = 0;  // 0: as many as fit; 1: the untiled run
  // What a tile may take of a worker's memory; 0: 4 GiB, or no limit where `tiles` gives a number.
  int64_t tile_memory_bytes = 0;
  int rounds = 0;  // outer loop; 0: the method's own
  std::string method = "tessera";
  MethodSettings method_settings = {};
  // What makes the likelihoods, in place of the scene's: the absolute path of a file that `tessera classify
  // --save-model` wrote, or kDefaultClassifier. Empty: nothing, but the default where a scene has neither likelihoods
  // nor labels (of a job that was accepted that is settled); kNoClassifier: nothing.
  std::string classifier = {};
  UpdateSettings update = {};
  double max_core_seconds = 0;  // a job that is predicted to take more is refused; 0: no limit
};

// Whether the job makes likelihoods itself.
bool Classifies(const JobSettings& settings);

// INVALID_ARGUMENT with every fault, one a line: what was found, what was expected.
Status CheckJobSettings(const JobSettings& settings);

// Those of an update, with the base's for what it takes from it. INVALID_ARGUMENT if it asks for other ones.
StatusOr<JobSettings> SettingsOfUpdate(const JobSettings& asked, const JobSettings& base);

}  // namespace tessera

#endif  // TESSERA_SERVER_SETTINGS_JOB_SETTINGS_H_
