#include "common/imaging/label_file.h"

#include <algorithm>
#include <cstring>
#include <limits>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "common/imaging/file_bytes.h"
#include "common/imaging/image_io.h"

namespace tessera {
namespace {

using Bytes = std::vector<uint8_t>;

constexpr uint8_t kPaletteType = 3;                             // PNG specification, section 11.2.1
constexpr size_t kHeaderEnd = 33, kDepthAt = 24, kTypeAt = 25;  // of a PNG; its first chunk is the header

uint32_t Word(const Bytes& bytes, size_t at) {
  return uint32_t{bytes[at]} << 24 | bytes[at + 1] << 16 | bytes[at + 2] << 8 | bytes[at + 3];
}

// Cyclic redundancy check of PNG chunks.
uint32_t Crc(const uint8_t* bytes, size_t count) {
  uint32_t crc = 0xffffffff;
  for (size_t i = 0; i < count; ++i) {
    crc ^= bytes[i];
    for (int bit = 0; bit < 8; ++bit) crc = crc & 1 ? 0xedb88320 ^ crc >> 1 : crc >> 1;
  }
  return ~crc;
}

struct PalettePng {
  Bytes indices;                  // a grey PNG of the indices
  std::vector<uint32_t> palette;  // as StoredLabels
};

// Replaces a palette by grey levels, because OpenCV gives colours in place of indices. `bytes` has a whole header.
PalettePng SplitPalette(const Bytes& bytes) {
  PalettePng out;
  out.indices.assign(bytes.begin(), bytes.begin() + kHeaderEnd);
  out.indices[kTypeAt] = 0;
  const uint32_t crc = Crc(out.indices.data() + 12, kHeaderEnd - 4 - 12);
  for (size_t k = 0; k < 4; ++k) out.indices[kHeaderEnd - 4 + k] = static_cast<uint8_t>(crc >> (24 - 8 * k));
  for (size_t at = kHeaderEnd; at + 12 <= bytes.size();) {
    const size_t size = Word(bytes, at);
    const uint8_t* data = bytes.data() + at + 8;
    const auto is = [&](const char* type) { return std::memcmp(bytes.data() + at + 4, type, 4) == 0; };
    const size_t end = std::min(bytes.size(), at + 12 + size);
    if (is("IDAT") || is("IEND")) out.indices.insert(out.indices.end(), bytes.begin() + at, bytes.begin() + end);
    for (size_t i = 0; is("PLTE") && 3 * i + 3 <= size && at + 8 + 3 * i + 3 <= bytes.size(); ++i) {
      out.palette.push_back(ColorValue({data[3 * i], data[3 * i + 1], data[3 * i + 2]}));
    }
    for (size_t i = 0; is("tRNS") && i < size && at + 8 + i < bytes.size() && i < out.palette.size(); ++i) {
      if (data[i] == 0) out.palette[i] = StoredLabels::kNone;
    }
    at = end;
  }
  return out;
}

// Class id of a colour; 255: unknown, -1: the colour of no class.
int ClassOfColor(uint32_t color, int classes, const LikelihoodForm& form) {
  if (color == StoredLabels::kNone) return 255;
  for (int c = 0; c < std::min(classes, static_cast<int>(form.colors.size())); ++c) {
    if (ColorValue(form.colors[c]) == color) return c;
  }
  return color == 0 ? 255 : -1;
}

// The same of an id.
int ClassOfId(uint32_t id, int classes, const LikelihoodForm& form) {
  const auto first = static_cast<uint32_t>(form.first_id.value_or(0));
  if (id == StoredLabels::kNone || id == 255 || id < first) return 255;
  return id - first < static_cast<uint32_t>(classes) ? static_cast<int>(id - first) : -1;
}

Status NoClassError(const StoredLabels& labels, const std::string& path, int x, int y, int classes,
                    const LikelihoodForm& form, bool by_color) {
  const uint32_t value = labels.values.at(x, y);
  const std::string location = absl::StrCat("pixel (", x, ", ", y, ")");
  if (!by_color && IdOf(labels, value) != StoredLabels::kNoId) {
    const int first = form.first_id.value_or(0);
    return InputError(
        path, location, absl::StrCat("label ", IdOf(labels, value)),
        absl::StrCat("a class from ", first, " to ", first + classes - 1, ", or 255 for unknown",
                     form.first_id ? "" : "; if ids count from 1, set \"likelihood_first_id\": 1 in scene.json"));
  }
  const auto add = [](std::string* out, const auto& color) { out->append(ColorText(ColorValue(color))); };
  return InputError(
      path, location, absl::StrCat("colour ", ColorText(ColorOf(labels, value))),
      absl::StrCat("the \"color\" of a class in scene.json", form.colors.empty() ? "" : " (",
                   absl::StrJoin(form.colors, ", ", add), form.colors.empty() ? "" : ")", ", or black for unknown"));
}

}  // namespace

uint32_t ColorOf(const StoredLabels& labels, uint32_t value) {
  if (labels.is_color || value == StoredLabels::kNone) return value;
  return value < static_cast<uint32_t>(labels.palette.size()) ? labels.palette[value] : StoredLabels::kNone;
}

uint32_t IdOf(const StoredLabels& labels, uint32_t value) {
  if (!labels.is_color || value == StoredLabels::kNone) return value;
  return (value & 255) * 0x010101 == value ? value & 255 : StoredLabels::kNoId;
}

std::string ColorText(uint32_t color) { return absl::StrFormat("#%06x", color); }

StatusOr<StoredLabels> ReadLabelPng(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(Bytes bytes, ReadFileBytes(path));
  StoredLabels labels;
  if (bytes.size() < kHeaderEnd) {
    return InputError(path, absl::StrCat("byte ", bytes.size()), "the end of the file", "a whole PNG header");
  }
  const int depth = bytes[kDepthAt];
  if (bytes[kTypeAt] == kPaletteType) {
    PalettePng split = SplitPalette(bytes);
    bytes = std::move(split.indices);
    labels.palette = std::move(split.palette);
    if (labels.palette.empty()) return InputError(path, "", "no palette", "the palette of a PNG of that type");
  }
  TESSERA_ASSIGN_OR_RETURN(PngPixels pixels, DecodePngPixels(path, bytes));
  labels.is_color = pixels.is_color;
  // Levels of fewer than 8 bits are decoded with 255 as the largest.
  const uint32_t step = depth == 1 ? 255 : depth == 2 ? 85 : depth == 4 ? 17 : 1;
  for (uint32_t& value : pixels.values.data) {
    if (labels.is_color) {
      value = value >> 24 == 0 ? StoredLabels::kNone : value & 0xffffff;
    } else {
      value = depth == 16 && value == 65535 ? StoredLabels::kNone : value / step;
    }
  }
  labels.values = std::move(pixels.values);
  return labels;
}

StatusOr<LabelImage> ClassesOf(const StoredLabels& labels, const std::string& path, int classes,
                               const LikelihoodForm& form, const ImagePart& part) {
  LabelImage image(labels.values.width, labels.values.height, 1, 255);
  const bool by_color = !form.colors.empty() && (labels.is_color || !labels.palette.empty());
  uint32_t last = StoredLabels::kNone;
  int label = 255;  // of `last`
  for (int y = part.y0; y < part.y1; ++y) {
    for (int x = part.x0; x < part.x1; ++x) {
      const uint32_t value = labels.values.at(x, y);
      if (value != last) {
        label = by_color ? ClassOfColor(ColorOf(labels, value), classes, form)
                         : ClassOfId(IdOf(labels, value), classes, form);
        if (label < 0) return NoClassError(labels, path, x, y, classes, form, by_color);
        last = value;
      }
      image.at(x, y) = static_cast<uint8_t>(label);
    }
  }
  return image;
}

}  // namespace tessera
