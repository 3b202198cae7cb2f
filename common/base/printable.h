// Makes text from outside (names, messages, paths) safe to print: it cannot move the terminal's cursor, start a new
// line or hide the text beside it.
#pragma once

#include <string>
#include <string_view>

namespace tessera {

// Escapes ("\n", "\x1b", "\u202e") control characters (C0, DEL, C1), line separators, zero-width characters, characters
// that change the direction of text, and bytes that are not UTF-8.
std::string Printable(std::string_view text);

// Like Printable, but keeps line ends and tabs, for messages of several lines.
std::string PrintableLines(std::string_view text);

// `text` as a JSON string, quotes included, with \u escapes in place of the same characters; bytes that are not UTF-8
// become U+FFFD.
std::string JsonQuoted(std::string_view text);

bool IsUtf8(std::string_view text);

// `text` unchanged if it is UTF-8 (protobuf requires UTF-8 strings), else PrintableLines(text).
std::string AsUtf8(const std::string& text);

// The first `max_bytes` of `text` or fewer, cut at a character boundary.
std::string_view Prefix(std::string_view text, size_t max_bytes);

}  // namespace tessera
