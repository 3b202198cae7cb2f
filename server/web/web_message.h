// Requests and answers of HTTP as the handlers see them, independent of connections.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/status.h"

namespace tessera {

using HeaderList = std::vector<std::pair<std::string, std::string>>;

struct WebRequest {
  std::string method;  // "GET"
  std::string target;  // as sent: path and query
  HeaderList headers;
  HeaderList params;  // of the query, decoded
  std::string body;
  std::string peer;  // as gRPC writes it: ipv4:127.0.0.1:5000
  bool tls = false;
  std::chrono::steady_clock::time_point arrived;  // whole

  // The only value of a header, whose name is not case-sensitive; nullopt if it is missing or repeated.
  std::optional<std::string> Header(std::string_view name) const;
  // The target's path: not decoded, without the query.
  std::string_view RawPath() const { return std::string_view(target).substr(0, target.find('?')); }
};

// Where an answer's bytes go.
struct AnswerSink {
  // False if the connection is lost or too slow: end the answer.
  std::function<bool(std::string_view bytes)> write;
  // False if the other end has closed the connection, or the server stops.
  std::function<bool()> connected;
};

struct WebAnswer {
  int status = 200;
  std::string type;  // Content-Type; empty: none
  std::string body;
  HeaderList headers;
  // Writes the body in place of `body`. False: broken off, so that the connection must end.
  std::function<bool(const AnswerSink& sink)> produce;
  std::optional<int64_t> produced_bytes;  // unset: not known, the body is sent in chunks
};

// HTTP's status for a call's.
int HttpStatusOf(absl::StatusCode code);
// {"code":"NOT_FOUND","message":"..."}, with Retry-After for what may be retried.
WebAnswer ErrorAnswer(const Status& status);
WebAnswer ErrorAnswer(int http_status, std::string_view code, std::string_view message);
WebAnswer JsonAnswer(std::string json);

// The decoded path of a target; NOT_FOUND for one that no route has: with encoded slashes, control characters, "." or
// ".." as a part, or malformed escapes.
StatusOr<std::string> DecodedPath(std::string_view raw);

}  // namespace tessera
