#include "server/http/visitors.h"

#include <algorithm>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "common/base/refusal.h"
#include "common/log/log.h"
#include "server/web/listener.h"

namespace tessera {
namespace {

constexpr char kCookie[] = "tessera_session";

Sessions::Clock::time_point Now() { return Sessions::Clock::now(); }

// The host of "ipv4:127.0.0.1:5000" or "ipv6:[::1]:5000".
std::string HostOf(const std::string& peer) {
  std::string host = peer.substr(peer.find(':') + 1);
  host = host.substr(0, host.rfind(':'));
  if (host.starts_with('[')) host = host.substr(1, host.size() - 2);
  return host;
}

// The value of the session's cookie; empty if there is none.
std::string CookieOf(const WebRequest& request) {
  const std::optional<std::string> header = request.Header("Cookie");
  if (!header) return "";
  for (absl::string_view part : absl::StrSplit(*header, ';')) {
    const std::pair<std::string, std::string> cookie =
        absl::StrSplit(absl::StripAsciiWhitespace(part), absl::MaxSplits('=', 1));
    if (cookie.first == kCookie) return cookie.second;
  }
  return "";
}

// Whether no page of another origin can make a browser send this host: such a page has a name of its own.
bool IsOwnHost(const std::string& host) {
  const size_t end = host.starts_with('[') ? host.find(']') + 1 : std::min(host.find(':'), host.size());
  const std::string name = host.substr(0, end);
  if (name.starts_with('[') || absl::EqualsIgnoreCase(name, "localhost")) return true;
  return !name.empty() && name.find_first_not_of("0123456789.") == std::string::npos;
}

}  // namespace

Status Visitors::CheckOrigin(const WebRequest& request) const {
  const std::string host = request.Header("Host").value_or("");
  // Where no token is asked for, a page whose name leads to this address (DNS rebinding) would have all rights.
  if (!access_.asks_for_tokens() && !insecure_ && !IsOwnHost(host)) {
    return absl::PermissionDeniedError(
        "permission denied: without tokens, the address must be localhost or a number, such as http://127.0.0.1");
  }
  if (request.method == "GET" || request.method == "HEAD") return absl::OkStatus();
  if (request.Header("X-Tessera") != "1") {
    return absl::PermissionDeniedError("permission denied: a change needs the header X-Tessera: 1");
  }
  const bool has_origin = std::any_of(request.headers.begin(), request.headers.end(), [](const auto& header) {
    return absl::EqualsIgnoreCase(header.first, "Origin");
  });
  if (!has_origin) return absl::OkStatus();
  const std::string origin = request.Header("Origin").value_or("");
  const size_t scheme = origin.find("://");
  const bool own = scheme != std::string::npos && absl::EqualsIgnoreCase(origin.substr(scheme + 3), host);
  const bool plain = absl::StartsWithIgnoreCase(origin, "http://");
  if (own && !(request.tls && plain)) return absl::OkStatus();
  return absl::PermissionDeniedError("permission denied: the request comes from a page of another origin");
}

Status Visitors::Refused(const WebRequest& request) {
  const std::string address = AddressKey(HostOf(request.peer));
  const GuessLimits::Verdict verdict = guesses_.Failed(address, Now());
  if (verdict == GuessLimits::Verdict::kUnknown) return absl::OkStatus();
  if (verdict == GuessLimits::Verdict::kFirstTooMany) {
    LogWarning("too many tokens that do not exist", {{"address", address}});
  }
  return RetryAfter(absl::ResourceExhaustedError("too many tokens that do not exist; try again later"),
                    static_cast<double>(GuessLimits::kWindow.count()));
}

Visitor Visitors::Known(const WebRequest& request) {
  Visitor visitor;
  visitor.caller.peer = request.peer;
  visitor.caller.authorization = request.Header("Authorization");
  if (!visitor.caller.authorization) {
    visitor.session = CookieOf(request);
    const std::optional<std::string> token =
        visitor.session.empty() ? std::nullopt : sessions_.TokenOf(visitor.session, Now());
    if (token) visitor.caller.authorization = "Bearer " + *token;
  }
  Caller& identity = visitor.identity;
  identity = access_.Identify(request.peer, visitor.caller.authorization);
  identity.client = identity.name.empty() ? request.peer.substr(0, request.peer.rfind(':')) : identity.name;
  return visitor;
}

StatusOr<Visitor> Visitors::Identify(const WebRequest& request) {
  Visitor visitor = Known(request);
  const bool has_token = request.Header("Authorization").has_value();
  if (has_token && visitor.identity.roles == 0) TESSERA_RETURN_IF_ERROR(Refused(request));
  return visitor;
}

std::string Visitors::ClientOf(const WebRequest& request) { return Known(request).identity.client; }

bool Visitors::StillHere(const Visitor& visitor) {
  if (!visitor.session.empty() && access_.asks_for_tokens() && !sessions_.TokenOf(visitor.session, Now())) return false;
  return access_.Identify(visitor.caller.peer, visitor.caller.authorization).roles != 0;
}

StatusOr<Visitor> Visitors::Begin(const WebRequest& request, const std::string& token) {
  Visitor visitor;
  visitor.caller = {"Bearer " + token, request.peer};
  visitor.identity = access_.Identify(request.peer, visitor.caller.authorization);
  if (visitor.identity.roles == 0) {
    TESSERA_RETURN_IF_ERROR(Refused(request));
    return absl::UnauthenticatedError("unauthenticated: the token is unknown or has expired");
  }
  if (!access_.asks_for_tokens()) return visitor;
  visitor.session = sessions_.Begin(token, Now());
  LogInfo("session begun", {{"user", visitor.identity.name}, {"peer", request.peer}});
  return visitor;
}

}  // namespace tessera
