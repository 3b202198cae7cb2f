#include "common/base/refusal.h"

#include <cstdlib>

#include "common/base/status_parts.h"

namespace tessera {
namespace {

constexpr char kReason[] = "Refusal", kLimitParts[] = "Limit", kDelay[] = "RetryDelay";
constexpr double kRestart_s = 3;  // typical time until a stopped coordinator runs again

}  // namespace

Status Refuse(Refusal reason, Status error) {
  SetParts(error, kReason, {std::to_string(static_cast<int>(reason))});
  return error;
}

Refusal RefusalOf(const Status& status) {
  const std::vector<std::string> parts = PartsOf(status, kReason);
  if (parts.size() != 1) return Refusal::kNone;
  for (const Refusal reason :
       {Refusal::kUnknownWorker, Refusal::kOtherVersion, Refusal::kNotCurrent, Refusal::kLimit, Refusal::kDraining}) {
    if (parts[0] == std::to_string(static_cast<int>(reason))) return reason;
  }
  return Refusal::kNone;
}

Status LimitError(const Limit& limit, const std::string& advice) {
  Status error =
      Refuse(Refusal::kLimit, absl::ResourceExhaustedError(limit.what + ": limit " + std::to_string(limit.most) +
                                                           " reached (tesserad " + limit.flag + "); " + advice));
  SetLimit(error, limit);
  return error;
}

void SetLimit(Status& error, const Limit& limit) {
  SetParts(error, kLimitParts, {limit.what, std::to_string(limit.most), limit.flag});
}

Limit LimitOf(const Status& status) {
  const std::vector<std::string> parts = PartsOf(status, kLimitParts);
  if (parts.size() != 3) return {};
  return {parts[0], std::strtoll(parts[1].c_str(), nullptr, 10), parts[2]};
}

Status DrainingError(const std::string& action) {
  return RetryAfter(
      Refuse(Refusal::kDraining, absl::UnavailableError("the coordinator is shutting down and " + action)), kRestart_s);
}

Status RetryAfter(Status error, double seconds) {
  SetParts(error, kDelay, {std::to_string(seconds)});
  return error;
}

double RetryDelayOf(const Status& status) {
  const std::vector<std::string> parts = PartsOf(status, kDelay);
  return parts.size() == 1 ? std::strtod(parts[0].c_str(), nullptr) : 0;
}

}  // namespace tessera
