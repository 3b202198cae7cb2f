// Why a coordinator refuses what a worker asks, where the worker acts on it: codes of statuses have other meanings too.
#ifndef TESSERA_COMMON_BASE_REFUSAL_H_
#define TESSERA_COMMON_BASE_REFUSAL_H_

#include "common/base/status.h"

namespace tessera {

// The numbers of these are those of tessera.v1.
enum class Refusal {
  kNone = 0,           // any other error
  kUnknownWorker = 1,  // not registered, or forgotten: to register again
  kOtherVersion = 2,   // of the algorithms: not to ask again
  kNotCurrent = 3,     // the attempt is over, or of a task that there is not: its work is to be dropped
};

// The error with its reason, which RefusalOf gives back; also across the network (status_conversion.h).
Status Refuse(Refusal reason, Status error);
Refusal RefusalOf(const Status& status);

}  // namespace tessera

#endif  // TESSERA_COMMON_BASE_REFUSAL_H_
