#include "common/base/refusal.h"

#include <string>

#include "absl/strings/cord.h"

namespace tessera {
namespace {

constexpr char kUrl[] = "type.tessera/Refusal";

}  // namespace

Status Refuse(Refusal reason, Status error) {
  error.SetPayload(kUrl, absl::Cord(std::to_string(static_cast<int>(reason))));
  return error;
}

Refusal RefusalOf(const Status& status) {
  const auto payload = status.GetPayload(kUrl);
  if (!payload) return Refusal::kNone;
  for (const Refusal reason : {Refusal::kUnknownWorker, Refusal::kOtherVersion, Refusal::kNotCurrent}) {
    if (*payload == std::to_string(static_cast<int>(reason))) return reason;
  }
  return Refusal::kNone;
}

}  // namespace tessera
