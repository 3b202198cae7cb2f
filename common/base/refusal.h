// Why a coordinator refuses what it is asked, where the caller acts on it: codes of statuses have other meanings too.
#ifndef TESSERA_COMMON_BASE_REFUSAL_H_
#define TESSERA_COMMON_BASE_REFUSAL_H_

#include <cstdint>
#include <string>

#include "common/base/status.h"

namespace tessera {

// The numbers of these are those of tessera.v1.
enum class Refusal {
  kNone = 0,           // any other error
  kUnknownWorker = 1,  // not registered, or forgotten: to register again
  kOtherVersion = 2,   // of the algorithms: not to ask again
  kNotCurrent = 3,     // the attempt is over, or of a task that there is not: its work is to be dropped
  kLimit = 4,          // the caller, or all together, have as much as they may; nothing was done
  kDraining = 5,       // the coordinator is about to end and takes nothing new; nothing was done
};

// What follows is given back by the function of the same matter, also across the network (status_conversion.h).

// The error with its reason.
Status Refuse(Refusal reason, Status error);
Refusal RefusalOf(const Status& status);

// Of what there is as much as there may be.
struct Limit {
  std::string what;  // "watches of 'anna'"
  int64_t most = 0;
  std::string flag;  // of tesserad, which sets it
};

// RESOURCE_EXHAUSTED, Refusal::kLimit, with the limit, how it is set and what to do (`advice`) in its message.
Status LimitError(const Limit& limit, const std::string& advice);
void SetLimit(Status& error, const Limit& limit);  // without a word in the message
// An empty `what` if no limit was told.
Limit LimitOf(const Status& status);

// UNAVAILABLE, Refusal::kDraining, of a coordinator that ends and so `does` no more what it is asked.
Status DrainingError(const std::string& does);

// The error with when the same call may succeed, in seconds.
Status RetryAfter(Status error, double seconds);
// 0: not known.
double RetryDelayOf(const Status& status);

}  // namespace tessera

#endif  // TESSERA_COMMON_BASE_REFUSAL_H_
