// Shortens long lists of errors or warnings for display.
#pragma once

#include <string>
#include <vector>

namespace tessera {

inline constexpr size_t kShownMessages = 20, kShownOfKind = 5;

// At most kShownMessages of the messages, in their order, then "... and N more". Messages that differ only in the file
// before the first ": ", in numbers and in quoted text are of one kind; the first kShownOfKind of each kind come before
// further ones of a frequent kind, so that no kind hides another. A last message "... and N more" of an earlier call is
// counted.
std::vector<std::string> ShortenMessages(const std::vector<std::string>& messages);

// The same for a text with one message per line. A line that begins with a space belongs to the message above it.
std::string ShortenLines(const std::string& text);

}  // namespace tessera
