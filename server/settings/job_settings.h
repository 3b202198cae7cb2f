// What a user asks of a job.
#ifndef TESSERA_SERVER_SETTINGS_JOB_SETTINGS_H_
#define TESSERA_SERVER_SETTINGS_JOB_SETTINGS_H_

#include <cstdint>
#include <string>

#include "common/base/status.h"
#include "common/tile/method_settings.h"

namespace tessera {

inline constexpr int kMaxTiles = 100000;
inline constexpr int kMaxRounds = 20;
inline constexpr int64_t kMinTileMemory = int64_t{128} << 20, kMaxTileMemory = int64_t{64} << 40;

// Everything in it enters the tasks' parameters, and so their keys.
struct JobSettings {
  int tiles = 0;  // 0: as many as fit; 1: the untiled run
  // What a tile may take of a worker's memory; 0: 4 GiB, or no limit where `tiles` gives a number.
  int64_t tile_memory_bytes = 0;
  int rounds = 0;  // outer loop; 0: the method's own
  std::string method = "tessera";
  MethodSettings method_settings = {};
};

// INVALID_ARGUMENT with every fault, one a line: what was found, what was expected.
Status CheckJobSettings(const JobSettings& settings);

}  // namespace tessera

#endif  // TESSERA_SERVER_SETTINGS_JOB_SETTINGS_H_
