// Watches of jobs: thousands of streams without a thread each.
#pragma once

#include <memory>

#include "server/auth/access.h"
#include "server/auth/client_limits.h"
#include "server/jobs/jobs.h"

namespace grpc {
class ByteBuffer;
class CallbackServerContext;
template <class Message>
class ServerWriteReactor;
}  // namespace grpc

namespace tessera {

// One thread checks the watched jobs after a change, serializes one message per changed job, and sends the same bytes
// to all its watchers. Each watch has at most one message in flight and then gets the newest one, so a slow watcher
// skips intermediate states. A watch whose token becomes invalid ends within about a second. Thread-safe.
class JobWatches {
 public:
  // The arguments must outlive this.
  JobWatches(DispatchCore& core, const Jobs& jobs, const Access* access, ClientLimits* limits);
  // The server must have ended.
  ~JobWatches();
  // Stops the thread. The server must have ended.
  void Stop();

  // Handles the call Jobs.WatchJob with serialized messages.
  grpc::ServerWriteReactor<grpc::ByteBuffer>* Watch(grpc::CallbackServerContext* context,
                                                    const grpc::ByteBuffer& request);

 private:
  class Watching;
  std::unique_ptr<Watching> watching_;
};

}  // namespace tessera
