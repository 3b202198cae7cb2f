#include "tests/support/bent_scene/picture_files.h"

#include <algorithm>

#include "tests/support/bent_scene/raw_bytes.h"

namespace tessera::bent {
namespace {

uint32_t Crc32(const std::string& bytes) {
  uint32_t crc = ~0u;
  for (const char c : bytes) {
    crc ^= static_cast<uint8_t>(c);
    for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ (crc & 1 ? 0xedb88320u : 0);
  }
  return ~crc;
}

std::string PngChunk(const std::string& type, const std::string& content) {
  return RawBigEndian(static_cast<uint32_t>(content.size())) + type + content + RawBigEndian(Crc32(type + content));
}

// A zlib stream of stored blocks.
std::string Stored(const std::string& bytes) {
  std::string out = "\x78\x01";
  uint32_t a = 1, b = 0;
  for (const char c : bytes) {
    a = (a + static_cast<uint8_t>(c)) % 65521;
    b = (b + a) % 65521;
  }
  for (size_t at = 0; at < bytes.size(); at += 65535) {
    const std::string block = bytes.substr(at, 65535);
    const auto length = static_cast<uint16_t>(block.size());
    out += at + block.size() == bytes.size() ? '\1' : '\0';
    out += Raw<uint16_t>({length, static_cast<uint16_t>(~length)}) + block;
  }
  return out + RawBigEndian(b << 16 | a);
}

}  // namespace

std::string TiffBytes(const TiffForm& form, const std::string& pixels) {
  struct Entry {
    uint16_t tag, type;
    uint32_t count, value;
  };
  constexpr uint16_t kShort = 3, kLong = 4;
  const auto channels = static_cast<uint32_t>(form.channels);
  std::vector<Entry> entries = {{256, kLong, 1, static_cast<uint32_t>(form.width)},
                                {257, kLong, 1, static_cast<uint32_t>(form.height)},
                                {258, kShort, channels, 0},  // bits of each channel
                                {259, kShort, 1, 1},         // not compressed
                                {262, kShort, 1, form.channels < 3 ? 1u : 2u},
                                {273, kLong, 1, 0},  // the strip
                                {277, kShort, 1, channels},
                                {278, kLong, 1, static_cast<uint32_t>(form.height)},
                                {279, kLong, 1, static_cast<uint32_t>(pixels.size())},
                                {284, kShort, 1, 1}};  // interleaved
  constexpr size_t kBits = 2, kStrip = 5;
  if (form.has_alpha) entries.push_back({338, kShort, 1, 2});
  if (form.is_float) entries.push_back({339, kShort, 1, 3});
  const auto after = static_cast<uint32_t>(8 + 2 + 12 * entries.size() + 4);
  const std::string bits =
      Raw<uint16_t>(std::vector<uint16_t>(channels + channels % 2, static_cast<uint16_t>(form.bits)));
  entries[kBits].value = channels > 2 ? after : static_cast<uint32_t>(form.bits);
  entries[kStrip].value = after + static_cast<uint32_t>(bits.size());
  std::string bytes =
      "II" + Raw<uint16_t>({42}) + Raw<uint32_t>({8}) + Raw<uint16_t>({static_cast<uint16_t>(entries.size())});
  for (const Entry& entry : entries) {
    bytes += Raw<uint16_t>({entry.tag, entry.type}) + Raw<uint32_t>({entry.count, entry.value});
  }
  return bytes + Raw<uint32_t>({0}) + bits + pixels;
}

std::string PngBytes(const ByteImage& image, const std::vector<std::array<uint8_t, 3>>& palette) {
  const char colour_type = !palette.empty() ? 3 : image.channels == 1 ? 0 : image.channels == 3 ? 2 : 6;
  std::string header = RawBigEndian(static_cast<uint32_t>(image.width)) +
                       RawBigEndian(static_cast<uint32_t>(image.height)) + '\x8' + colour_type + std::string(3, '\0');
  const std::string pixels = Interleaved<uint8_t>(image, 1);
  const size_t row = static_cast<size_t>(image.width) * image.channels;
  std::string rows, colours;
  for (int y = 0; y < image.height; ++y) rows += '\0' + pixels.substr(y * row, row);
  for (const auto& colour : palette) colours.append(colour.begin(), colour.end());
  return "\x89PNG\r\n\x1a\n" + PngChunk("IHDR", header) + (palette.empty() ? "" : PngChunk("PLTE", colours)) +
         PngChunk("IDAT", Stored(rows)) + PngChunk("IEND", "");
}

std::string WithExifOrientation(const std::string& jpeg, int orientation) {
  const std::string exif = std::string("Exif\0\0", 6) + "II" + Raw<uint16_t>({42}) + Raw<uint32_t>({8}) +
                           Raw<uint16_t>({1, 0x0112, 3}) + Raw<uint32_t>({1, static_cast<uint32_t>(orientation), 0});
  std::string segment = "\xff\xe1";
  segment += RawBigEndian(static_cast<uint16_t>(exif.size() + 2));
  // After the JFIF segment, if there is one.
  size_t at = 2;
  if (jpeg.substr(2, 2) == "\xff\xe0") at += 2 + (static_cast<uint8_t>(jpeg[4]) << 8 | static_cast<uint8_t>(jpeg[5]));
  return jpeg.substr(0, at) + segment + exif + jpeg.substr(at);
}

}  // namespace tessera::bent
