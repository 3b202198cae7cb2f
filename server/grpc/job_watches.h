// Who watches jobs: thousands at once, without a thread for each.
#ifndef TESSERA_SERVER_GRPC_JOB_WATCHES_H_
#define TESSERA_SERVER_GRPC_JOB_WATCHES_H_

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

// One thread looks at the watched jobs when something has changed, makes a message of each that has, and gives all who
// watch it the same bytes. Of each watch one message is under way; when that is gone, the newest follows, so that who
// is slow holds one message that others may be done with. Callers whose token is not good any more are told so within
// about a second. Thread-safe.
class JobWatches {
 public:
  // All must outlive this.
  JobWatches(DispatchCore& core, const Jobs& jobs, const Access* access, ClientLimits* limits);
  // The server must have ended.
  ~JobWatches();
  // No job is looked at any more. The server must have ended.
  void Stop();

  // The call Jobs.WatchJob; messages as bytes.
  grpc::ServerWriteReactor<grpc::ByteBuffer>* Watch(grpc::CallbackServerContext* context,
                                                    const grpc::ByteBuffer& request);

 private:
  class Watching;
  std::unique_ptr<Watching> watching_;
};

}  // namespace tessera

#endif  // TESSERA_SERVER_GRPC_JOB_WATCHES_H_
