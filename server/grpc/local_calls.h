// Calls of the coordinator's own services from inside its process, for callers who come another way than by gRPC.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "common/base/status.h"
#include "server/auth/access.h"

namespace grpc {
class Channel;
}  // namespace grpc

namespace tessera {

// For whom a call is made.
struct LocalCaller {
  std::optional<std::string> authorization;  // as the metadata key of that name: "Bearer TOKEN"
  std::string peer;                          // address as gRPC writes it, such as ipv4:127.0.0.1:5000
};

// A call has the rights of its caller's token and no more: Access admits it before it is made, and the services, audit
// and limits see the token and the caller's address as those of a call over the network. Thread-safe.
class LocalCalls {
 public:
  // `channel`: to the server in this process. `access` must outlive this.
  LocalCalls(std::shared_ptr<grpc::Channel> channel, const Access* access);
  // All streams must have ended.
  ~LocalCalls();

  // OK, UNAUTHENTICATED or PERMISSION_DENIED, as Access::Admit.
  Status Admit(const std::string& method, const LocalCaller& caller) const;

  // Calls a method with one answer, such as "/tessera.v1.Jobs/GetJob". `request`: the serialized message; returns the
  // serialized answer. Errors of Admit and of the method; DEADLINE_EXCEEDED after `deadline_s`; ABORTED after Stop.
  StatusOr<std::string> Call(const std::string& method, const LocalCaller& caller, const std::string& request,
                             double deadline_s);

  // A call with a stream of answers. Not thread-safe.
  class Stream {
   public:
    // Cancels the call if it has not ended.
    ~Stream();
    // Waits at most `seconds` for the next serialized message.
    enum class Event { kMessage, kTimeout, kEnd };
    Event Read(double seconds, std::string* message);
    // Why the stream ended, after kEnd.
    const Status& status() const;

   private:
    friend class LocalCalls;
    struct Impl;
    explicit Stream(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
  };
  // Errors of Admit; those of the method end the stream. Must not outlive this.
  StatusOr<std::unique_ptr<Stream>> Open(const std::string& method, const LocalCaller& caller,
                                         const std::string& request);

  // Cancels running calls, and refuses others.
  void Stop();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera
