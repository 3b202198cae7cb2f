// Conversion between absl::Status and grpc::Status; their codes have the same numbers.
#pragma once

#include "common/base/status.h"

namespace grpc {
class Status;
}  // namespace grpc

namespace tessera {

// Converts the status of a call. A code outside gRPC's becomes UNKNOWN. CANCELLED becomes ABORTED: a client that
// cancels its own call does not use the status, so it was the server that stopped, and idempotent calls may be retried.
Status FromGrpc(const grpc::Status& status);

// Converts the result of a service method. gRPC sends the message in a header, for which MakeChannel's clients accept
// 1 MiB (other clients 8 KiB by default). Messages above 96 KiB are cut at a line end; the last line states the number
// of omitted bytes.
grpc::Status ToGrpc(const Status& status);

}  // namespace tessera
