#include "server/settings/job_settings.h"

#include "absl/strings/str_cat.h"

namespace tessera {

Status CheckJobSettings(const JobSettings& settings) {
  Faults faults;
  const auto check = [&faults](const char* name, int found, int high, const char* zero) {
    if (found >= 0 && found <= high) return;
    faults.Add(
        absl::InvalidArgumentError(absl::StrCat(name, ": found ", found, ", expected 0 (", zero, ") to ", high)));
  };
  check("tiles", settings.tiles, kMaxTiles, "as many as fit");
  const int64_t memory = settings.tile_memory_bytes;
  if (memory != 0 && (memory < kMinTileMemory || memory > kMaxTileMemory)) {
    faults.Add(absl::InvalidArgumentError(absl::StrCat("tile memory: found ", memory,
                                                       " bytes, expected 0 (4 GiB, or what a given number of tiles "
                                                       "takes) or 128 MiB to 64 TiB")));
  }
  check("rounds", settings.rounds, kMaxRounds, "the method's own");
  faults.Add(CheckMethod(settings.method, settings.method_settings));
  return faults.ToStatus();
}

}  // namespace tessera
