// gRPC's status is ours by number; only the type differs.
#ifndef TESSERA_COMMON_RPC_STATUS_CONVERSION_H_
#define TESSERA_COMMON_RPC_STATUS_CONVERSION_H_

#include "common/base/status.h"

namespace grpc {
class Status;
}  // namespace grpc

namespace tessera {

// What a call returned, as our own status. A code that gRPC does not know becomes UNKNOWN. CANCELLED becomes ABORTED:
// who breaks a call off himself knows it; else it was a server that stops, and the call may be repeated as any that may
// have been carried out.
Status FromGrpc(const grpc::Status& status);

// What a service method returns. gRPC sends the message in a header, of which MakeChannel's clients take 1 MiB (others
// by default 8 KiB): messages longer than 96 KiB are cut at a line, with a last line that says so.
grpc::Status ToGrpc(const Status& status);

}  // namespace tessera

#endif  // TESSERA_COMMON_RPC_STATUS_CONVERSION_H_
