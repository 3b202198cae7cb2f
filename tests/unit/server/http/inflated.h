// Reads gzip streams.
#pragma once

#include <gtest/gtest.h>
#include <zlib.h>

#include <string>

namespace tessera {

// What a reader of the bytes has; `whole`: they are a complete gzip stream with the right checksum.
inline std::string Inflated(const std::string& bytes, bool* whole) {
  z_stream stream = {};
  EXPECT_EQ(inflateInit2(&stream, 16 + MAX_WBITS), Z_OK);
  std::string text(1 << 20, '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(text.data());
  stream.avail_out = static_cast<uInt>(text.size());
  const int result = inflate(&stream, Z_SYNC_FLUSH);
  *whole = result == Z_STREAM_END && stream.avail_in == 0;
  EXPECT_TRUE(result == Z_OK || result == Z_STREAM_END) << result;
  text.resize(stream.total_out);
  inflateEnd(&stream);
  return text;
}

}  // namespace tessera
