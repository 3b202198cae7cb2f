#include "server/api/caller.h"

#include <grpcpp/grpcpp.h>

namespace tessera {

Caller CallerOf(const grpc::ServerContextBase& context) {
  Caller caller;
  caller.peer = context.peer();
  const auto auth = context.auth_context();
  if (auth == nullptr || !auth->IsPeerAuthenticated()) return caller;
  const auto names = auth->GetPeerIdentity();
  if (!names.empty()) caller.user.assign(names.front().data(), names.front().size());
  return caller;
}

}  // namespace tessera
