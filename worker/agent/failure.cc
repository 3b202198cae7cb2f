#include "worker/agent/failure.h"

#include <sstream>

#include "absl/strings/cord.h"

namespace tessera {
namespace {

constexpr char kPayload[] = "tessera/failure";

}  // namespace

Status AsStatus(const Failure& failure) {
  std::ostringstream text;
  text << static_cast<int>(failure.failure_class);
  for (const Digest& digest : failure.lost_inputs) text << " " << digest.sha256 << " " << digest.size_bytes;
  Status status = absl::UnknownError(failure.message);
  status.SetPayload(kPayload, absl::Cord(text.str()));
  return status;
}

bool IsFailure(const Status& status) { return status.GetPayload(kPayload).has_value(); }

Failure FailureOf(const Status& status) {
  Failure failure;
  failure.message = std::string(status.message().data(), status.message().size());
  if (const auto payload = status.GetPayload(kPayload)) {
    std::istringstream text{std::string(*payload)};
    int failure_class = 0;
    text >> failure_class;
    failure.failure_class = static_cast<FailureClass>(failure_class);
    for (Digest digest; text >> digest.sha256 >> digest.size_bytes;) failure.lost_inputs.push_back(digest);
  }
  return failure;
}

}  // namespace tessera
