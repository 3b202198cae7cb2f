// Text that came from outside (names, messages, paths) in a form that is safe to print: nothing in it moves a
// terminal's cursor, begins a line of its own, or hides what stands beside it.
#ifndef TESSERA_COMMON_BASE_PRINTABLE_H_
#define TESSERA_COMMON_BASE_PRINTABLE_H_

#include <string>
#include <string_view>

namespace tessera {

// `text` with escapes ("\n", "\x1b", "\u202e") in place of control characters (C0, DEL, C1), separators of lines,
// characters that have no width or change the direction of text, and bytes that are not UTF-8.
std::string Printable(std::string_view text);

// The same but for line ends, which stay: for messages of several lines.
std::string PrintableLines(std::string_view text);

// `text` as a JSON string, quotes included, with \u escapes in place of the same characters; bytes that are not UTF-8
// become U+FFFD.
std::string JsonQuoted(std::string_view text);

bool IsUtf8(std::string_view text);

// `text` as it is if it is UTF-8, which protobuf asks of all strings; else PrintableLines of it.
std::string AsUtf8(const std::string& text);

// At most `max_bytes` of `text`, cut between two characters.
std::string_view Prefix(std::string_view text, size_t max_bytes);

}  // namespace tessera

#endif  // TESSERA_COMMON_BASE_PRINTABLE_H_
