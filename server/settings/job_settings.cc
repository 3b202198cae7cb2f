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
  check("rounds", settings.rounds, kMaxRounds, "the method's own");
  faults.Add(CheckMethod(settings.method, settings.method_settings));
  return faults.ToStatus();
}

}  // namespace tessera
