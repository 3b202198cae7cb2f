#include "common/imaging/image_header.h"

#include <algorithm>
#include <cstring>
#include <string_view>

#include "absl/strings/str_cat.h"
#include "common/imaging/file_bytes.h"
#include "common/imaging/tiff_file.h"
#include "common/storage/lfs_pointer.h"

namespace tessera {
namespace {

using HeaderBytes = std::vector<uint8_t>;

bool StartsWith(const HeaderBytes& bytes, const char* magic, size_t size) {
  return bytes.size() >= size && std::memcmp(bytes.data(), magic, size) == 0;
}

uint32_t BigEndian(const HeaderBytes& bytes, size_t at, int count) {
  uint32_t value = 0;
  for (int i = 0; i < count; ++i) value = value << 8 | bytes[at + i];
  return value;
}

// The orientation tag in the first directory of EXIF data (a TIFF header) in bytes [begin, end); 1 if there is none.
int ExifOrientation(const HeaderBytes& bytes, size_t begin, size_t end) {
  constexpr uint32_t kOrientationTag = 274;
  end = std::min(end, bytes.size());
  if (end < begin + 8) return 1;
  const bool big = bytes[begin] == 'M';
  const auto number = [&](size_t at, int count) {
    uint32_t value = 0;
    for (int i = 0; i < count; ++i) value = value << 8 | bytes[at + (big ? i : count - 1 - i)];
    return value;
  };
  const size_t directory = begin + number(begin + 4, 4);
  if (directory + 2 > end) return 1;
  const size_t entries = number(directory, 2);
  for (size_t i = 0, at = directory + 2; i < entries && at + 12 <= end; ++i, at += 12) {
    if (number(at, 2) == kOrientationTag) return static_cast<int>(std::clamp(number(at + 8, 2), 1u, 8u));
  }
  return 1;
}

// Walks the marker segments up to the first scan (ITU T.81, annex B). Returns the offset of the first start-of-scan
// marker; 0 if there is none.
size_t WalkJpeg(const HeaderBytes& bytes, ImageHeader* header) {
  size_t at = 2;
  while (at + 4 <= bytes.size() && bytes[at] == 0xff) {
    const uint8_t marker = bytes[at + 1];
    if (marker == 0xff) {  // fill byte
      ++at;
      continue;
    }
    if (marker == 0xda) return at;
    const size_t next = at + 2 + BigEndian(bytes, at + 2, 2);
    const bool is_frame = marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (is_frame && at + 9 <= bytes.size()) {
      header->size = {static_cast<int>(BigEndian(bytes, at + 7, 2)), static_cast<int>(BigEndian(bytes, at + 5, 2))};
    }
    if (marker == 0xe1 && at + 10 <= bytes.size() && std::memcmp(&bytes[at + 4], "Exif\0", 6) == 0) {
      header->orientation = ExifOrientation(bytes, at + 10, next);
    }
    at = next;
  }
  return 0;
}

// Walks the chunks up to the image data.
void WalkPng(const HeaderBytes& bytes, ImageHeader* header) {
  header->size = {static_cast<int>(BigEndian(bytes, 16, 4)), static_cast<int>(BigEndian(bytes, 20, 4))};
  header->bits = bytes[24] == 16 ? 16 : 8;
  constexpr int kAlpha = 4, kGrey = 0;
  header->has_alpha = (bytes[25] & kAlpha) != 0;
  for (size_t at = 8; at + 8 <= bytes.size();) {
    const size_t length = BigEndian(bytes, at, 4);
    const std::string_view type(reinterpret_cast<const char*>(&bytes[at + 4]), 4);
    if (type == "IDAT") return;
    if (type == "tRNS" && bytes[25] != kGrey) header->has_alpha = true;
    if (type == "eXIf") header->orientation = ExifOrientation(bytes, at + 8, at + 8 + length);
    at += 12 + length;
  }
}

}  // namespace

bool IsPng(const HeaderBytes& bytes) { return StartsWith(bytes, "\x89PNG\r\n\x1a\n", 8); }
bool IsJpeg(const HeaderBytes& bytes) { return StartsWith(bytes, "\xff\xd8\xff", 3); }
bool IsTiff(const HeaderBytes& bytes) {
  return StartsWith(bytes, "II*\0", 4) || StartsWith(bytes, "MM\0*", 4) || StartsWith(bytes, "II+\0", 4) ||
         StartsWith(bytes, "MM\0+", 4);
}

bool JpegEnds(const HeaderBytes& bytes) {
  ImageHeader header;
  const size_t scan = WalkJpeg(bytes, &header);
  if (scan == 0) return false;
  for (size_t i = bytes.size() - 1; i > scan; --i) {
    if (bytes[i] == 0xd9 && bytes[i - 1] == 0xff) return true;
  }
  return false;
}

StatusOr<ImageHeader> HeaderOf(const std::string& path, const HeaderBytes& bytes) {
  ImageHeader header;
  if (IsTiff(bytes)) {
    TESSERA_ASSIGN_OR_RETURN(const TiffPhotographHeader tiff, ReadTiffPhotographHeader(path));
    header.size = {tiff.width, tiff.height};
    header.bits = tiff.bits;
    header.has_alpha = tiff.has_alpha;
    header.orientation = tiff.orientation;
    return header;
  }
  if (IsJpeg(bytes)) {
    WalkJpeg(bytes, &header);
    return header;
  }
  if (IsLfsPointer({reinterpret_cast<const char*>(bytes.data()), bytes.size()})) return LfsPointerError(path);
  if (!IsPng(bytes)) {
    return InputError(path, "byte 0", bytes.empty() ? "an empty file" : "an unknown format",
                      "a JPEG, PNG or TIFF image");
  }
  if (bytes.size() < 33) {
    return InputError(path, absl::StrCat("byte ", bytes.size()), "the end of the file", "a whole PNG header");
  }
  WalkPng(bytes, &header);
  return header;
}

StatusOr<ImageHeader> ReadImageHeader(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(HeaderBytes bytes, ReadFileStart(path, 64 * 1024));
  TESSERA_ASSIGN_OR_RETURN(ImageHeader header, HeaderOf(path, bytes));
  if (IsJpeg(bytes) && header.size.width == 0) {  // long metadata before the frame header
    TESSERA_ASSIGN_OR_RETURN(bytes, ReadFileBytes(path));
    WalkJpeg(bytes, &header);
  }
  if (header.size.width <= 0 || header.size.height <= 0) {
    return InputError(path, "", "no image size in the header", "a JPEG, PNG or TIFF image");
  }
  return header;
}

}  // namespace tessera
