// Finds the end of an HTTP/1.1 request in the bytes of a connection, before anything interprets it.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace tessera {

struct FrameLimits {
  size_t head_bytes = 16 << 10;  // request line and headers
  size_t target_bytes = 4 << 10;
  int headers = 100;
  size_t body_bytes = 1 << 20;
};

// The first request in a buffer.
struct RequestFrame {
  enum class State { kIncomplete, kComplete, kRefused };
  State state = State::kIncomplete;
  int refusal = 0;        // HTTP status of the answer to a refused request
  bool has_head = false;  // the rest is valid
  size_t size_bytes = 0;  // of head and body
  size_t body_bytes = 0;
  std::string method;  // "GET"
  std::string target;  // as sent
  // Request line and headers without those below, ends with an empty line.
  std::string head;
  std::string range, accept_encoding, expect;
};

// `bytes`: what a connection received since the last request. Refuses what is too large (413, 414, 431), a body without
// a length (501), and what parsers may understand differently: folded or repeated headers, control characters (400).
RequestFrame FindRequest(std::string_view bytes, const FrameLimits& limits);

}  // namespace tessera
