// Invariants that fuzz targets check of the readers that they call.
#pragma once

#include <cstdio>
#include <cstdlib>

#include "common/base/status.h"

namespace tessera {

// Aborts unless the promise was kept: libFuzzer and the replay of its corpus both see that.
inline void Require(bool kept, const char* promise) {
  if (kept) return;
  std::fprintf(stderr, "broken promise: %s\n", promise);
  std::abort();
}

// That input was refused as input, in words that a person can read.
inline void RequireRefusal(const Status& status, absl::StatusCode code = absl::StatusCode::kInvalidArgument) {
  Require(status.code() == code, "wrong input has its own code");
  Require(!status.message().empty() && status.message().size() < 10'000, "a refusal says why, in few words");
}

// The same of a reader that collects faults. True if there are none.
inline bool Accepted(const Faults& faults) {
  const Status status = faults.ToStatus();
  if (!status.ok()) Require(status.code() == absl::StatusCode::kInvalidArgument, "wrong input has its own code");
  return status.ok();
}

}  // namespace tessera
