#include "common/base/printable.h"

#include <cstdint>

#include "absl/strings/str_format.h"

namespace tessera {
namespace {

struct Character {
  uint32_t code = 0;
  size_t bytes = 1;
  bool valid = false;  // false: one byte that does not start a character
};

// Decodes the first character of `text`, which is not empty. Overlong forms and surrogates are invalid.
Character First(std::string_view text) {
  const auto byte = [&](size_t i) { return static_cast<unsigned char>(text[i]); };
  const uint32_t lead = byte(0);
  if (lead < 0x80) return {lead, 1, true};
  const size_t bytes = lead >= 0xF5 ? 0 : lead >= 0xF0 ? 4 : lead >= 0xE0 ? 3 : lead >= 0xC2 ? 2 : 0;
  if (bytes == 0 || text.size() < bytes) return {};
  uint32_t code = lead & (0x7F >> bytes);
  for (size_t i = 1; i < bytes; ++i) {
    if ((byte(i) & 0xC0) != 0x80) return {};
    code = code << 6 | (byte(i) & 0x3F);
  }
  const bool overlong = (bytes == 3 && code < 0x800) || (bytes == 4 && code < 0x10000);
  if (overlong || code > 0x10FFFF || (code >= 0xD800 && code < 0xE000)) return {};
  return {code, bytes, true};
}

// Whether the character must be escaped. U+200C and U+200D are not: words and emoji use them.
bool IsHidden(uint32_t code) {
  struct Range {
    uint32_t first, last;
  };
  static constexpr Range kHidden[] = {{0x00, 0x1F},     {0x7F, 0x9F},     {0xAD, 0xAD},      {0x61C, 0x61C},
                                      {0x200B, 0x200B}, {0x200E, 0x200F}, {0x2028, 0x202E},  {0x2060, 0x206F},
                                      {0xFEFF, 0xFEFF}, {0xFFF9, 0xFFFB}, {0xE0000, 0xE007F}};
  for (const Range& range : kHidden) {
    if (code >= range.first && code <= range.last) return true;
  }
  return false;
}

std::string Escaped(std::string_view text, bool keep_lines) {
  std::string out;
  out.reserve(text.size());
  while (!text.empty()) {
    const Character character = First(text);
    if (!character.valid) {
      absl::StrAppendFormat(&out, "\\x%02x", static_cast<unsigned char>(text[0]));
    } else if (character.code == '\n' && !keep_lines) {
      out += "\\n";
    } else if (character.code == '\t' && !keep_lines) {
      out += "\\t";
    } else if (character.code == '\n' || character.code == '\t' || !IsHidden(character.code)) {
      out += text.substr(0, character.bytes);
    } else if (character.code < 0x80) {
      absl::StrAppendFormat(&out, "\\x%02x", character.code);
    } else {
      absl::StrAppendFormat(&out, "\\u%04x", character.code);
    }
    text.remove_prefix(character.bytes);
  }
  return out;
}

}  // namespace

std::string Printable(std::string_view text) { return Escaped(text, /*keep_lines=*/false); }

std::string PrintableLines(std::string_view text) { return Escaped(text, /*keep_lines=*/true); }

std::string JsonQuoted(std::string_view text) {
  std::string out = "\"";
  while (!text.empty()) {
    const Character character = First(text);
    if (!character.valid) {
      out += "\\ufffd";
    } else if (character.code == '"' || character.code == '\\') {
      out += '\\';
      out += static_cast<char>(character.code);
    } else if (character.code == '\n') {
      out += "\\n";
    } else if (!IsHidden(character.code)) {
      out += text.substr(0, character.bytes);
    } else if (character.code < 0x10000) {
      absl::StrAppendFormat(&out, "\\u%04x", character.code);
    } else {  // a surrogate pair
      absl::StrAppendFormat(&out, "\\u%04x\\u%04x", 0xD800 + ((character.code - 0x10000) >> 10),
                            0xDC00 + ((character.code - 0x10000) & 0x3FF));
    }
    text.remove_prefix(character.bytes);
  }
  return out + '"';
}

bool IsUtf8(std::string_view text) {
  while (!text.empty()) {
    const Character character = First(text);
    if (!character.valid) return false;
    text.remove_prefix(character.bytes);
  }
  return true;
}

std::string AsUtf8(const std::string& text) { return IsUtf8(text) ? text : PrintableLines(text); }

std::string_view Prefix(std::string_view text, size_t max_bytes) {
  if (text.size() <= max_bytes) return text;
  size_t end = max_bytes;
  while (end > 0 && max_bytes - end < 4 && (static_cast<unsigned char>(text[end]) & 0xC0) == 0x80) --end;
  return text.substr(0, end);
}

}  // namespace tessera
