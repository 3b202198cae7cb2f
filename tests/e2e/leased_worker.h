// A worker of the test's own, for calls that only one with a lease may make.
#ifndef TESSERA_TESTS_E2E_LEASED_WORKER_H_
#define TESSERA_TESTS_E2E_LEASED_WORKER_H_

#include <memory>
#include <string>

#include "common/base/status.h"

namespace grpc {
class Channel;
}

namespace tessera::e2e {

// Registers a worker at the coordinator and waits up to 20 s for a lease; the channel's calls are the worker's.
// UNAVAILABLE if there was no task.
StatusOr<std::shared_ptr<grpc::Channel>> ConnectLeasedWorker(const std::string& address);

}  // namespace tessera::e2e

#endif  // TESSERA_TESTS_E2E_LEASED_WORKER_H_
