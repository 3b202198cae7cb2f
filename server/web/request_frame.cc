#include "server/web/request_frame.h"

#include <algorithm>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"

namespace tessera {
namespace {

constexpr std::string_view kLineEnd = "\r\n", kHeadEnd = "\r\n\r\n";

bool IsTokenCharacter(char c) {
  return absl::ascii_isalnum(static_cast<unsigned char>(c)) ||
         std::string_view("!#$%&'*+-.^_`|~").find(c) != std::string_view::npos;
}

bool IsToken(std::string_view text) { return !text.empty() && std::all_of(text.begin(), text.end(), IsTokenCharacter); }

bool HasControlCharacter(std::string_view text) {
  return std::any_of(text.begin(), text.end(), [](char c) {
    const auto byte = static_cast<unsigned char>(c);
    return (byte < 0x20 && c != '\t') || byte == 0x7f;
  });
}

std::string_view Trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

bool SameName(std::string_view name, const char* other) {
  return absl::EqualsIgnoreCase(absl::string_view(name.data(), name.size()), other);
}

// What a head says; an HTTP status if it is refused, else 0.
class HeadReader {
 public:
  HeadReader(const FrameLimits& limits, RequestFrame* frame) : limits_(limits), frame_(*frame) {}

  // `head`: lines, each with its end, without the empty one.
  int Read(std::string_view head) {
    int lines = 0;
    while (!head.empty()) {
      const size_t end = head.find(kLineEnd);
      const std::string_view line = head.substr(0, end);
      head.remove_prefix(end + kLineEnd.size());
      if (HasControlCharacter(line)) return 400;
      if (++lines > limits_.headers + 1) return 431;
      if (const int refusal = lines == 1 ? ReadRequestLine(line) : ReadHeader(line); refusal != 0) return refusal;
    }
    if (lines == 0 || (needs_host_ && hosts_ != 1)) return 400;
    frame_.head.append(kLineEnd);
    return 0;
  }

 private:
  int ReadRequestLine(std::string_view line) {
    const size_t first = line.find(' '), last = line.rfind(' ');
    if (first == std::string_view::npos || first == last) return line.size() > limits_.target_bytes ? 414 : 400;
    const std::string_view method = line.substr(0, first), target = line.substr(first + 1, last - first - 1),
                           version = line.substr(last + 1);
    if (target.size() > limits_.target_bytes) return 414;
    if (!IsToken(method) || target.empty() || target.front() != '/' || target.find(' ') != std::string_view::npos) {
      return 400;
    }
    if (!version.starts_with("HTTP/")) return 400;
    if (version != "HTTP/1.1" && version != "HTTP/1.0") return 505;
    needs_host_ = version == "HTTP/1.1";
    frame_.method = method;
    frame_.target = target;
    Keep(line);
    return 0;
  }

  int ReadHeader(std::string_view line) {
    const size_t colon = line.find(':');
    if (colon == std::string_view::npos || !IsToken(line.substr(0, colon))) return 400;
    const std::string_view name = line.substr(0, colon), value = Trimmed(line.substr(colon + 1));
    if (SameName(name, "Transfer-Encoding") || SameName(name, "Upgrade")) return 501;
    if (SameName(name, "Host") && ++hosts_ > 1) return 400;
    if (SameName(name, "Content-Length")) return ReadLength(value);
    for (const auto& [known, set] : {std::pair{"Range", &frame_.range},
                                     {"Accept-Encoding", &frame_.accept_encoding},
                                     {"Expect", &frame_.expect}}) {
      if (!SameName(name, known)) continue;
      *set = value;
      return 0;
    }
    Keep(line);
    return 0;
  }

  int ReadLength(std::string_view value) {
    if (has_length_ || value.empty() || value.size() > 18 ||
        !std::all_of(value.begin(), value.end(), [](char c) { return c >= '0' && c <= '9'; })) {
      return has_length_ || value.size() <= 18 ? 400 : 413;
    }
    has_length_ = true;
    frame_.body_bytes = std::stoull(std::string(value));
    return frame_.body_bytes > limits_.body_bytes ? 413 : 0;
  }

  void Keep(std::string_view line) { frame_.head.append(line).append(kLineEnd); }

  const FrameLimits& limits_;
  RequestFrame& frame_;
  bool needs_host_ = false, has_length_ = false;
  int hosts_ = 0;
};

}  // namespace

RequestFrame FindRequest(std::string_view bytes, const FrameLimits& limits) {
  RequestFrame frame;
  const auto refuse = [&](int status) {
    frame.state = RequestFrame::State::kRefused;
    frame.refusal = status;
    return frame;
  };
  // An empty line before a request is allowed (RFC 9112, section 2.2).
  size_t skipped = 0;
  while (skipped < 4 && bytes.starts_with(kLineEnd)) {
    bytes.remove_prefix(kLineEnd.size());
    skipped += kLineEnd.size();
  }
  const size_t end = bytes.substr(0, limits.head_bytes).find(kHeadEnd);
  if (end == std::string_view::npos) {
    if (bytes.size() < limits.head_bytes) return frame;
    return refuse(bytes.find(kLineEnd) == std::string_view::npos ? 414 : 431);
  }
  if (const int refusal = HeadReader(limits, &frame).Read(bytes.substr(0, end + kLineEnd.size())); refusal != 0) {
    return refuse(refusal);
  }
  frame.has_head = true;
  frame.size_bytes = skipped + end + kHeadEnd.size() + frame.body_bytes;
  if (skipped + bytes.size() >= frame.size_bytes) frame.state = RequestFrame::State::kComplete;
  return frame;
}

}  // namespace tessera
