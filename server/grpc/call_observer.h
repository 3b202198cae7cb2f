// Interceptor of all calls: counts every call and audits those that change something.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "server/auth/access.h"
#include "server/metrics/rpc_counts.h"

namespace grpc::experimental {
class ServerInterceptorFactoryInterface;
}  // namespace grpc::experimental

namespace tessera {

// All methods of tessera.v1, as gRPC names them.
std::vector<std::string> AllMethods();

// For a ServerBuilder. `counts`, constructed from AllMethods, and `access` must outlive the server. Calls that `access`
// refuses do not reach the interceptor. `before_reply`: called before each message and status that a call sends; may be
// empty.
std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface> ObserveCalls(RpcCounts* counts,
                                                                                    const Access* access,
                                                                                    std::function<void()> before_reply);

}  // namespace tessera
