// A registered worker with a lease, for calls that only such a worker may make.
#pragma once

#include <memory>
#include <string>

#include "common/base/status.h"

namespace grpc {
class Channel;
}

namespace tessera::e2e {

// Registers a worker at the coordinator and waits up to 20 s for a lease. Calls over the channel carry the worker's
// secret. UNAVAILABLE if no task was ready.
StatusOr<std::shared_ptr<grpc::Channel>> ConnectLeasedWorker(const std::string& address);

}  // namespace tessera::e2e
