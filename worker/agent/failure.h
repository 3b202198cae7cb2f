// Failure of an attempt with its class, carried inside a Status whose code is irrelevant.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/storage/hash.h"

namespace tessera {

// Mirrors the proto's ErrorClass, which documents each value.
enum class FailureClass { kInput, kLostInput, kMemory, kScratch, kStorage, kPeer, kPreempted, kInternal };

struct Failure {
  FailureClass failure_class = FailureClass::kInternal;
  std::string message;
  std::vector<Digest> lost_inputs = {};  // for kLostInput
};

// Wraps the failure in a Status, which must be passed on unchanged.
Status AsStatus(const Failure& failure);
inline Status AsStatus(FailureClass failure_class, const std::string& message) {
  return AsStatus(Failure{failure_class, message});
}

// Whether the status was made by AsStatus.
bool IsFailure(const Status& status);

// The wrapped failure, or kInternal with the status's message.
Failure FailureOf(const Status& status);

}  // namespace tessera
