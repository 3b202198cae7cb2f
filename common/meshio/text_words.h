// Words and numbers of text formats.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace tessera {

inline bool IsBlank(char c) { return c == ' ' || c == '\t' || c == '\r'; }

inline void SkipBlanks(std::string_view& rest) {
  size_t n = 0;
  while (n < rest.size() && IsBlank(rest[n])) ++n;
  rest.remove_prefix(n);
}

// Removes the first word of `rest`, which begins with no blank, and the blanks after it. Empty if there is none.
inline std::string_view TakeWord(std::string_view& rest) {
  size_t n = 0;
  while (n < rest.size() && !IsBlank(rest[n])) ++n;
  const std::string_view word = rest.substr(0, n);
  rest.remove_prefix(n);
  SkipBlanks(rest);
  return word;
}

// False unless the whole word is a number. Numbers out of a double's range become zero or infinity.
bool ParseInteger(std::string_view word, int64_t& value);
bool ParseNumber(std::string_view word, double& value);

// `text` for messages: in quotes, cut at 40 characters, unprintable characters escaped.
std::string Quoted(std::string_view text);

}  // namespace tessera
