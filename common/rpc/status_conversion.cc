#include "common/rpc/status_conversion.h"

#include <grpcpp/support/status.h>

#include <string>
#include <utility>
#include <vector>

#include "common/base/printable.h"
#include "common/base/refusal.h"
#include "tessera/v1/errors.pb.h"

namespace tessera {
namespace {

constexpr size_t kMaxMessageBytes = 96 << 10;  // percent-encoding makes it up to three times as long
constexpr size_t kMaxDetailsBytes = 4 << 10, kMaxFaultTextBytes = 256;

std::string Shortened(std::string message) {
  if (message.size() <= kMaxMessageBytes) return message;
  size_t end = message.rfind('\n', kMaxMessageBytes);
  if (end == std::string::npos) end = kMaxMessageBytes;
  while (end > 0 && (static_cast<unsigned char>(message[end]) & 0xC0) == 0x80) --end;  // not inside a UTF-8 character
  const size_t left_out = message.size() - end;
  message.resize(end);
  return message + "\n... and " + std::to_string(left_out) + " more bytes of messages";
}

// protobuf requires UTF-8, but text from files may hold any bytes.
std::string Text(const std::string& text) { return Printable(std::string(Prefix(text, kMaxFaultTextBytes))); }

v1::Refusal DetailsOf(const Status& status) {
  v1::Refusal refusal;
  refusal.set_reason(static_cast<v1::Refusal::Reason>(RefusalOf(status)));
  refusal.set_retry_s(RetryDelayOf(status));
  if (const Limit limit = LimitOf(status); !limit.what.empty()) {
    refusal.mutable_limit()->set_what(Text(limit.what));
    refusal.mutable_limit()->set_maximum(limit.most);
    refusal.mutable_limit()->set_flag(limit.flag);
  }
  for (const InputFault& fault : FaultsOf(status)) {
    v1::InputFault& added = *refusal.add_faults();
    added.set_file(Text(fault.file));
    added.set_location(Text(fault.location));
    added.set_found(Text(fault.found));
    added.set_expected(Text(fault.expected));
    if (refusal.ByteSizeLong() <= kMaxDetailsBytes) continue;
    refusal.mutable_faults()->RemoveLast();
    break;
  }
  return refusal;
}

Status WithDetails(Status error, const v1::Refusal& refusal) {
  if (refusal.reason() != v1::Refusal::REASON_UNSPECIFIED) {
    error = Refuse(static_cast<Refusal>(refusal.reason()), std::move(error));
  }
  if (refusal.has_limit()) {
    const v1::Limit& limit = refusal.limit();
    SetLimit(error, {limit.what(), limit.maximum(), limit.flag()});
  }
  if (refusal.retry_s() > 0) error = RetryAfter(std::move(error), refusal.retry_s());
  std::vector<InputFault> faults;
  for (const v1::InputFault& fault : refusal.faults()) {
    faults.push_back({fault.file(), fault.location(), fault.found(), fault.expected()});
  }
  SetFaults(error, faults);
  return error;
}

}  // namespace

Status FromGrpc(const grpc::Status& status) {
  if (status.ok()) return absl::OkStatus();
  if (status.error_code() == grpc::StatusCode::CANCELLED) {
    return absl::AbortedError("the server cancelled the call: it is shutting down");
  }
  const int code = status.error_code();
  const bool known = code > 0 && code <= static_cast<int>(absl::StatusCode::kUnauthenticated);
  Status error(known ? static_cast<absl::StatusCode>(code) : absl::StatusCode::kUnknown, status.error_message());
  v1::Refusal refusal;
  if (status.error_details().empty() || !refusal.ParseFromString(status.error_details())) return error;
  return WithDetails(std::move(error), refusal);
}

grpc::Status ToGrpc(const Status& status) {
  if (status.ok()) return grpc::Status::OK;
  return grpc::Status(static_cast<grpc::StatusCode>(status.code()),
                      Shortened(std::string(status.message().data(), status.message().size())),
                      DetailsOf(status).SerializeAsString());
}

}  // namespace tessera
