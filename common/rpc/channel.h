// Connections to a coordinator.
#ifndef TESSERA_COMMON_RPC_CHANNEL_H_
#define TESSERA_COMMON_RPC_CHANNEL_H_

#include <memory>
#include <mutex>
#include <string>
#include <utility>

#include "common/base/status.h"
#include "common/storage/files.h"

namespace grpc {
class Channel;
class ClientContext;
class ServerBuilder;
}  // namespace grpc

namespace tessera {

// Pings of an idle or silent connection: a dead peer is noticed within their sum.
inline constexpr int kKeepaliveTimeMs = 20'000;
inline constexpr int kKeepaliveTimeoutMs = 10'000;

// Of a worker's calls: who it is, and the secret that it was given when it registered.
inline constexpr char kWorkerMetadata[] = "tessera-worker";
inline constexpr char kWorkerSecretMetadata[] = "tessera-worker-secret";

// Where a coordinator is, and what a caller shows it.
struct Endpoint {
  Endpoint() = default;
  Endpoint(std::string at) : address(std::move(at)) {}
  Endpoint(const char* at) : address(at) {}

  std::string address;  // HOST:PORT or unix:PATH
  // Files, all optional. The authorities that sign coordinators' certificates: without them no TLS is spoken.
  std::string tls_ca;
  std::string tls_cert, tls_key;  // the caller's own
  std::string token_file;
};

// unix:PATH of the coordinator that a user runs without saying where: in the folder that tesserad uses by default.
std::string DefaultAddress();
// That folder; empty if there is no home.
std::string DefaultDataFolder();

// Whether only this machine can reach the address: unix:PATH, localhost, 127.x.x.x or [::1].
bool IsLocalAddress(const std::string& address);
bool IsSocketAddress(const std::string& address);
// INVALID_ARGUMENT unless it is HOST:PORT or unix:PATH with a path that fits a socket's address.
Status CheckAddress(const std::string& address);

// What a process shows with every call on a channel. Thread-safe.
class CallIdentity {
 public:
  // The token's file is read again when it changes.
  explicit CallIdentity(std::string token_file = "") : token_file_(std::move(token_file)) {}
  // From now on calls are this worker's.
  void SetWorker(const std::string& worker, const std::string& secret);

  struct Shown {
    std::string token, worker, secret;  // empty: none
  };
  Shown Get();
  // Whether the token can be read.
  Status Check();

 private:
  Status RefreshLocked();

  const std::string token_file_;
  std::mutex mutex_;
  FileStamp stamp_ = {};
  Shown shown_;
};

// A channel without TLS to an address on this machine, or one whose coordinator asks nobody who he is; connects on
// first use, and again whenever the connection is lost (back-off from 0.1 s to 3 s). Thread-safe. Proxies of the
// environment are not used. `identity`: null: nothing is shown.
std::shared_ptr<grpc::Channel> MakeChannel(const std::string& address,
                                           std::shared_ptr<CallIdentity> identity = nullptr);

// The same as the endpoint says. INVALID_ARGUMENT if a token would leave this machine without TLS; errors of the files.
// `identity`: of the endpoint's token file.
StatusOr<std::shared_ptr<grpc::Channel>> OpenChannel(const Endpoint& endpoint, std::shared_ptr<CallIdentity> identity);

// What a server must allow so that MakeChannel's pings are not taken for abuse. Call before BuildAndStart.
void AllowKeepalive(grpc::ServerBuilder& builder);

// Waits until the channel is connected: UNAVAILABLE naming `address` after `seconds`.
Status WaitConnected(grpc::Channel& channel, const std::string& address, double seconds);

// Sets the call's deadline.
void SetDeadline(grpc::ClientContext& context, double seconds);

}  // namespace tessera

#endif  // TESSERA_COMMON_RPC_CHANNEL_H_
