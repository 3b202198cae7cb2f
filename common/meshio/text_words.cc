#include "common/meshio/text_words.h"

#include <charconv>
#include <cstdlib>
#include <string>

#include "absl/strings/str_cat.h"
#include "common/base/printable.h"

namespace tessera {

bool ParseInteger(std::string_view word, int64_t& value) {
  if (word.size() > 1 && word[0] == '+' && word[1] != '-') word.remove_prefix(1);
  const auto [stop, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  return error == std::errc() && stop == word.data() + word.size();
}

bool ParseNumber(std::string_view word, double& value) {
  if (word.size() > 1 && word[0] == '+' && word[1] != '-') word.remove_prefix(1);
  const auto [stop, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (stop != word.data() + word.size()) return false;
  if (error == std::errc::result_out_of_range) value = std::strtod(std::string(word).c_str(), nullptr);
  return error == std::errc() || error == std::errc::result_out_of_range;
}

std::string Quoted(std::string_view text) {
  return absl::StrCat("'", Printable(Prefix(text, 40)), text.size() > 40 ? "..." : "", "'");
}

}  // namespace tessera
