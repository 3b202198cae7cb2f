// Machine-readable reasons of a coordinator's errors, for callers that act on them. A status code alone is ambiguous.
#pragma once

#include <cstdint>
#include <string>

#include "common/base/status.h"

namespace tessera {

// The numbers equal those of tessera.v1.Refusal.Reason.
enum class Refusal {
  kNone = 0,           // any other error
  kUnknownWorker = 1,  // the worker is not registered or its registration expired: register again
  kOtherVersion = 2,   // the worker's algorithm version differs: do not retry
  kNotCurrent = 3,     // the attempt has ended or its task does not exist: drop its work
  kLimit = 4,          // a limit of the caller or of the coordinator is reached; the call had no effect
  kDraining = 5,       // the coordinator is shutting down and accepts nothing new; the call had no effect
};

// Each setter below has a getter that returns the same value, also after the error crossed the network
// (status_conversion.h).

// Adds `reason` to `error`.
Status Refuse(Refusal reason, Status error);
Refusal RefusalOf(const Status& status);

// A limit that was reached.
struct Limit {
  std::string what;  // "watches of 'anna'"
  int64_t most = 0;
  std::string flag;  // the option of tesserad that sets it, such as "--max-watches"
};

// RESOURCE_EXHAUSTED with Refusal::kLimit. The message states the limit, the option that sets it and what to do
// (`advice`).
Status LimitError(const Limit& limit, const std::string& advice);
void SetLimit(Status& error, const Limit& limit);  // leaves the message unchanged
// `what` is empty if the error carries no limit.
Limit LimitOf(const Status& status);

// UNAVAILABLE with Refusal::kDraining: "the coordinator is shutting down and ACTION", such as "accepts no jobs".
Status DrainingError(const std::string& action);

// Adds to `error` the time in seconds after which the same call may succeed.
Status RetryAfter(Status error, double seconds);
// 0: unknown.
double RetryDelayOf(const Status& status);

}  // namespace tessera
