// Who makes a call.
#ifndef TESSERA_SERVER_API_CALLER_H_
#define TESSERA_SERVER_API_CALLER_H_

#include <string>

namespace grpc {
class ServerContextBase;
}  // namespace grpc

namespace tessera {

struct Caller {
  std::string peer;  // where the call comes from, as gRPC writes addresses
  std::string user;  // as whom the connection or call was authenticated; empty: it was not
};

Caller CallerOf(const grpc::ServerContextBase& context);

}  // namespace tessera

#endif  // TESSERA_SERVER_API_CALLER_H_
