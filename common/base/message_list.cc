#include "common/base/message_list.h"

#include <algorithm>
#include <cstdint>
#include <map>
#include <string_view>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

namespace tessera {
namespace {

constexpr char kMore[] = "... and ", kMoreEnd[] = " more";

// The number of messages that an earlier call left out, if the message says so; else 0.
int64_t LeftOutBy(const std::string& message) {
  if (!message.starts_with(kMore) || !message.ends_with(kMoreEnd)) return 0;
  const size_t begin = std::string_view(kMore).size(), end = message.rfind(kMoreEnd);
  int64_t count = 0;
  return end > begin && absl::SimpleAtoi(message.substr(begin, end - begin), &count) && count > 0 ? count : 0;
}

// The message without its file, numbers and quoted text.
std::string KindOf(const std::string& message) {
  const size_t colon = message.find(": ");
  std::string kind;
  bool quoted = false;
  for (size_t i = colon == std::string::npos ? 0 : colon; i < message.size(); ++i) {
    if (message[i] == '\'') quoted = !quoted;
    if (!quoted && !absl::ascii_isdigit(static_cast<unsigned char>(message[i]))) kind.push_back(message[i]);
  }
  return kind;
}

}  // namespace

std::vector<std::string> ShortenMessages(const std::vector<std::string>& messages) {
  if (messages.size() <= kShownMessages) return messages;
  std::vector<char> is_shown(messages.size());
  std::map<std::string, size_t> of_kind;
  size_t shown = 0;
  int64_t left_out = 0;
  for (const size_t most : {kShownOfKind, messages.size()}) {
    for (size_t i = 0; i < messages.size() && shown < kShownMessages; ++i) {
      if (is_shown[i] || LeftOutBy(messages[i]) > 0 || of_kind[KindOf(messages[i])] >= most) continue;
      ++of_kind[KindOf(messages[i])];
      is_shown[i] = 1;
      ++shown;
    }
  }
  std::vector<std::string> list;
  for (size_t i = 0; i < messages.size(); ++i) {
    if (is_shown[i]) {
      list.push_back(messages[i]);
    } else {
      left_out += std::max<int64_t>(1, LeftOutBy(messages[i]));
    }
  }
  if (left_out > 0) list.push_back(absl::StrCat(kMore, left_out, kMoreEnd));
  return list;
}

std::string ShortenLines(const std::string& text) {
  std::vector<std::string> messages;
  const std::vector<std::string> lines = absl::StrSplit(text, '\n');
  for (const std::string& line : lines) {
    if (!messages.empty() && line.starts_with(' ')) {
      absl::StrAppend(&messages.back(), "\n", line);
    } else {
      messages.push_back(line);
    }
  }
  return absl::StrJoin(ShortenMessages(messages), "\n");
}

}  // namespace tessera
