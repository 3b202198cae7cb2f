// The standard health service of a coordinator (grpc.health.v1).
#pragma once

#include "common/base/status.h"
#include "common/rpc/channel.h"

namespace tessera {

// OK if a coordinator answers within `timeout_s` that it serves. One call, without retries. UNAVAILABLE with the reason
// if nobody answers or the coordinator does not serve; the errors of OpenChannel and of the call. Thread-safe.
Status CheckHealth(const Endpoint& endpoint, double timeout_s);

}  // namespace tessera
