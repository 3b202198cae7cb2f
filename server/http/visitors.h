// Who makes a request: by a session's cookie or by a token, or everybody where no tokens are asked for.
#pragma once

#include <optional>
#include <string>

#include "common/base/status.h"
#include "server/auth/access.h"
#include "server/grpc/local_calls.h"
#include "server/http/sessions.h"
#include "server/web/web_message.h"

namespace tessera {

struct Visitor {
  LocalCaller caller;
  Caller identity;      // without roles: nobody who may do anything
  std::string session;  // id of the cookie, if the request has no token of its own
};

// Thread-safe.
class Visitors {
 public:
  // `access` must outlive this. `insecure`: tesserad was told that only trusted callers can reach it.
  Visitors(const Access* access, bool insecure) : access_(*access), insecure_(insecure) {}

  // Refuses what a page of another origin could make a browser send: PERMISSION_DENIED.
  Status CheckOrigin(const WebRequest& request) const;

  // The visitor now: a token that was revoked or has expired gives no roles. RESOURCE_EXHAUSTED if the address has sent
  // too many tokens that do not exist.
  StatusOr<Visitor> Identify(const WebRequest& request);
  // The key of the client limits of a request that is not checked yet; its address if it has no rights.
  std::string ClientOf(const WebRequest& request);
  // Whether the visitor would be identified again, for answers that take long.
  bool StillHere(const Visitor& visitor);

  // Begins a session; returns its visitor. UNAUTHENTICATED for a token that does not exist, and as Identify.
  StatusOr<Visitor> Begin(const WebRequest& request, const std::string& token);
  void End(const Visitor& visitor) { sessions_.End(visitor.session); }

 private:
  // As Identify, without counting tokens that do not exist.
  Visitor Known(const WebRequest& request);
  Status Refused(const WebRequest& request);

  const Access& access_;
  const bool insecure_;
  Sessions sessions_;
  GuessLimits guesses_;
};

}  // namespace tessera
