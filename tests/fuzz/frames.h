// Inputs of several frames: each has a byte for its kind, its length (u16, little-endian) and its bytes.
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

namespace tessera {

struct InputFrame {
  uint8_t kind = 0;
  std::string bytes;
};

// Every input has frames; one whose length is too large takes what is left.
inline std::vector<InputFrame> SplitFrames(const std::string& input) {
  std::vector<InputFrame> frames;
  for (size_t at = 0; input.size() - at >= 3;) {
    const size_t length = static_cast<uint8_t>(input[at + 1]) + 256 * static_cast<uint8_t>(input[at + 2]);
    const size_t taken = std::min(length, input.size() - at - 3);
    frames.push_back({static_cast<uint8_t>(input[at]), input.substr(at + 3, taken)});
    at += 3 + taken;
  }
  return frames;
}

inline std::string JoinFrames(const std::vector<InputFrame>& frames) {
  std::string input;
  for (const InputFrame& frame : frames) {
    const size_t length = std::min<size_t>(frame.bytes.size(), 65535);
    input += static_cast<char>(frame.kind);
    input += static_cast<char>(length % 256);
    input += static_cast<char>(length / 256);
    input += frame.bytes.substr(0, length);
  }
  return input;
}

}  // namespace tessera
