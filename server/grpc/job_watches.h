// Watches of jobs: thousands of streams without a thread each.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "common/base/status.h"
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

// A state of a job, shared by all its watchers.
struct JobUpdate {
  int64_t number = 0;  // ascending; no two states in this process have the same
  std::string etag;
  std::string message;  // serialized WatchJobResponse
  bool last = false;    // the job has ended
};

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

  class Watching;

  // A watch inside this process, whose rights its owner checks. It costs no call: a reader waits for the next state.
  // Not thread-safe. Must not outlive the JobWatches.
  class Local {
   public:
    ~Local();
    // Waits at most `seconds` for a state that was not read yet. Skips all but the newest. kEnd: the state of the end
    // was read, or the watch is over for another reason.
    enum class Event { kUpdate, kTimeout, kEnd };
    Event Read(double seconds, std::shared_ptr<const JobUpdate>* update);
    // After kEnd: why; OK if the job has ended.
    const Status& status() const { return status_; }

   private:
    friend class JobWatches;
    Local(Watching& watching, const std::string& job) : watching_(watching), job_(job) {}
    Watching& watching_;
    const std::string job_;
    int64_t seen_ = 0;  // number of the update that was read last
    bool saw_last_ = false;
    Status status_;
    ClientLimits::Ticket ticket_;
  };
  // `client`: as Caller::client. `seen_etag`: of the last state that the caller has; empty: none. NOT_FOUND;
  // RESOURCE_EXHAUSTED as ClientLimits; UNAVAILABLE while the coordinator stops.
  StatusOr<std::unique_ptr<Local>> Open(const std::string& client, const std::string& job,
                                        const std::string& seen_etag);
  // The state of a job, at most as old as two messages of a watch are apart. Errors as Open.
  StatusOr<std::shared_ptr<const JobUpdate>> Newest(const std::string& job);

 private:
  std::unique_ptr<Watching> watching_;
};

}  // namespace tessera
