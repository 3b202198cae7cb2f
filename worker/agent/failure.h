// What failed, as workers tell it: carried by a Status, whose code means nothing here.
#ifndef TESSERA_WORKER_AGENT_FAILURE_H_
#define TESSERA_WORKER_AGENT_FAILURE_H_

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/storage/hash.h"

namespace tessera {

// As the proto's ErrorClass, which says what each is.
enum class FailureClass { kInput, kLostInput, kMemory, kScratch, kStorage, kPeer, kPreempted, kInternal };

struct Failure {
  FailureClass failure_class = FailureClass::kInternal;
  std::string message;
  std::vector<Digest> lost_inputs = {};  // of kLostInput
};

// An error that carries the failure as long as it is passed on as it is.
Status AsStatus(const Failure& failure);
inline Status AsStatus(FailureClass failure_class, const std::string& message) {
  return AsStatus(Failure{failure_class, message});
}

// Whether AsStatus made it.
bool IsFailure(const Status& status);

// The failure that the error carries; kInternal, with its message, if it carries none.
Failure FailureOf(const Status& status);

}  // namespace tessera

#endif  // TESSERA_WORKER_AGENT_FAILURE_H_
