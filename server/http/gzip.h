// Compression of answers.
#pragma once

#include <cstdint>
#include <string>

namespace tessera {

// Empty if it cannot be compressed.
std::string Gzip(const std::string& text);

// A compressed text that can follow any other one in a stream, so that all streams share it.
struct GzipPart {
  explicit GzipPart(const std::string& text);
  std::string bytes;  // deflate blocks that refer to nothing before them and end at a byte
  uint32_t crc = 0;   // of the text
  uint64_t text_bytes = 0;
};

// One stream: its head, then parts, then its end.
class GzipStream {
 public:
  // The bytes that add `part` to the stream.
  std::string Add(const GzipPart& part);
  // The bytes that end it.
  std::string End() const;

 private:
  bool begun_ = false;
  uint32_t crc_ = 0;
  uint64_t text_bytes_ = 0;
};

}  // namespace tessera
