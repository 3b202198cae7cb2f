#include "common/rpc/status_conversion.h"

#include <grpcpp/support/status.h>

#include <string>
#include <utility>

#include "common/base/refusal.h"
#include "tessera/v1/workers.pb.h"

namespace tessera {
namespace {

constexpr size_t kMaxMessageBytes = 96 << 10;  // percent-encoded at worst three times as long

std::string Shortened(std::string message) {
  if (message.size() <= kMaxMessageBytes) return message;
  size_t end = message.rfind('\n', kMaxMessageBytes);
  if (end == std::string::npos) end = kMaxMessageBytes;
  while (end > 0 && (static_cast<unsigned char>(message[end]) & 0xC0) == 0x80) --end;  // not inside a UTF-8 character
  const size_t left_out = message.size() - end;
  message.resize(end);
  return message + "\n... and " + std::to_string(left_out) + " more bytes of messages";
}

}  // namespace

Status FromGrpc(const grpc::Status& status) {
  if (status.ok()) return absl::OkStatus();
  if (status.error_code() == grpc::StatusCode::CANCELLED) {
    return absl::AbortedError("the call was broken off before it was answered: the other side stops");
  }
  const int code = status.error_code();
  const bool known = code > 0 && code <= static_cast<int>(absl::StatusCode::kUnauthenticated);
  Status error(known ? static_cast<absl::StatusCode>(code) : absl::StatusCode::kUnknown, status.error_message());
  v1::Refusal refusal;
  if (status.error_details().empty() || !refusal.ParseFromString(status.error_details())) return error;
  return Refuse(static_cast<Refusal>(refusal.reason()), std::move(error));
}

grpc::Status ToGrpc(const Status& status) {
  if (status.ok()) return grpc::Status::OK;
  std::string details;
  if (const Refusal reason = RefusalOf(status); reason != Refusal::kNone) {
    v1::Refusal refusal;
    refusal.set_reason(static_cast<v1::Refusal::Reason>(reason));
    details = refusal.SerializeAsString();
  }
  return grpc::Status(static_cast<grpc::StatusCode>(status.code()),
                      Shortened(std::string(status.message().data(), status.message().size())), details);
}

}  // namespace tessera
