// Connections to a coordinator.
#ifndef TESSERA_COMMON_RPC_CHANNEL_H_
#define TESSERA_COMMON_RPC_CHANNEL_H_

#include <memory>
#include <string>

#include "common/base/status.h"

namespace grpc {
class Channel;
class ClientContext;
class ServerBuilder;
}  // namespace grpc

namespace tessera {

// Pings of an idle or silent connection: a dead peer is noticed within their sum.
inline constexpr int kKeepaliveTimeMs = 20'000;
inline constexpr int kKeepaliveTimeoutMs = 10'000;

// A channel to `address` ("host:port"); connects on first use, and again whenever the connection is lost (back-off from
// 0.1 s to 3 s). Thread-safe. Proxies of the environment are not used.
std::shared_ptr<grpc::Channel> MakeChannel(const std::string& address);

// What a server must allow so that MakeChannel's pings are not taken for abuse. Call before BuildAndStart.
void AllowKeepalive(grpc::ServerBuilder& builder);

// Waits until the channel is connected: UNAVAILABLE naming `address` after `seconds`.
Status WaitConnected(grpc::Channel& channel, const std::string& address, double seconds);

// Sets the call's deadline.
void SetDeadline(grpc::ClientContext& context, double seconds);

}  // namespace tessera

#endif  // TESSERA_COMMON_RPC_CHANNEL_H_
