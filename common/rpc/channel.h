// gRPC channels to a coordinator: addresses, TLS, credentials, keepalive.
#pragma once

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

// Keepalive pings of an idle connection: a dead peer is detected within the sum of the two.
inline constexpr int kKeepaliveTimeMs = 20'000;
inline constexpr int kKeepaliveTimeoutMs = 10'000;

// Metadata keys of a worker's calls: its name, and the secret that it received when it registered.
inline constexpr char kWorkerMetadata[] = "tessera-worker";
inline constexpr char kWorkerSecretMetadata[] = "tessera-worker-secret";

// The address of a coordinator and the credentials of the caller.
struct Endpoint {
  Endpoint() = default;
  Endpoint(std::string to) : address(std::move(to)) {}
  Endpoint(const char* to) : address(to) {}

  // HOST:PORT, unix:PATH, or a list HOST:PORT,HOST:PORT of coordinators that take over from each other.
  std::string address;
  // PEM files, all optional. `tls_ca`: the certificate authorities that the caller trusts; empty: no TLS.
  std::string tls_ca;
  std::string tls_cert, tls_key;  // of the caller, for mutual TLS
  std::string token_file;
  std::string store_ca;  // certificate authorities of the coordinator's object store, PEM; empty: the system's
};

// unix:PATH of the socket in DefaultDataFolder(), on which tesserad listens by default.
std::string DefaultAddress();
// The default data folder of tesserad: $XDG_DATA_HOME/tessera or ~/.local/share/tessera; empty if HOME is not set.
std::string DefaultDataFolder();

// Whether the address is reachable from this machine only: unix:PATH, localhost, 127.x.x.x or [::1].
bool IsLocalAddress(const std::string& address);
bool IsSocketAddress(const std::string& address);
// INVALID_ARGUMENT unless the address is HOST:PORT or unix:PATH with an absolute path that fits into sockaddr_un.
Status CheckAddress(const std::string& address);
// Whether the address of an endpoint is a list.
bool IsAddressList(const std::string& address);
// INVALID_ARGUMENT unless the address of an endpoint is one that CheckAddress accepts, or a list of HOST:PORT.
Status CheckEndpointAddress(const std::string& address);

// The credentials that a process sends with every call on a channel. Thread-safe.
class CallIdentity {
 public:
  // The token file is read again when it changes.
  explicit CallIdentity(std::string token_file = "") : token_file_(std::move(token_file)) {}
  // Later calls also carry this worker's name and secret.
  void SetWorker(const std::string& worker, const std::string& secret);

  struct Credentials {
    std::string token, worker, secret;  // empty: none
  };
  Credentials Get();
  // The error of reading the token file, if any.
  Status Check();

 private:
  Status RefreshLocked();

  const std::string token_file_;
  std::mutex mutex_;
  FileStamp stamp_ = {};
  Credentials credentials_;
};

// A channel without TLS, for local addresses and for coordinators without access control. It connects on first use and
// reconnects after a loss (back-off from 0.1 s to 3 s). Thread-safe. Ignores the environment's proxies. `identity`
// null: sends no credentials.
std::shared_ptr<grpc::Channel> MakeChannel(const std::string& address,
                                           std::shared_ptr<CallIdentity> identity = nullptr);

// Like MakeChannel, with the endpoint's TLS settings. INVALID_ARGUMENT if a token would be sent over the network
// without TLS; errors of reading the files. `identity` is made from the endpoint's token file. Certificates are renewed
// when their files change (TlsCertificates).
//
// Of a list, the first address that accepts a connection is used; after a loss, all are tried again in order. Its names
// are resolved here, once: UNAVAILABLE if one has no address. (gRPC resolves the name of a single address at every
// connection.) With TLS, the certificate of each coordinator must name the first host of the list.
StatusOr<std::shared_ptr<grpc::Channel>> OpenChannel(const Endpoint& endpoint, std::shared_ptr<CallIdentity> identity);

// Makes a server accept MakeChannel's keepalive pings (the default answer is too_many_pings). Call before
// BuildAndStart.
void AllowKeepalive(grpc::ServerBuilder& builder);

// Waits until the channel is connected; after `seconds`, UNAVAILABLE with `address` in the message.
Status WaitConnected(grpc::Channel& channel, const std::string& address, double seconds);

// Sets the call's deadline.
void SetDeadline(grpc::ClientContext& context, double seconds);

}  // namespace tessera
