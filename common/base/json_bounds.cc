#include "common/base/json_bounds.h"

#include <algorithm>

namespace tessera {

Status CheckJsonDepth(const std::string& what, std::string_view text) {
  int depth = 0, deepest = 0;
  bool in_string = false;
  for (size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (c == '"') {
      in_string = !in_string;
    } else if (in_string) {
      if (c == '\\') ++i;
    } else if (c == '[' || c == '{') {
      deepest = std::max(deepest, ++depth);
    } else if (c == ']' || c == '}') {
      --depth;
    }
  }
  if (deepest <= kMaxJsonDepth) return absl::OkStatus();
  return InputError(what, "", "JSON nested " + std::to_string(deepest) + " levels deep",
                    "at most " + std::to_string(kMaxJsonDepth) + " levels");
}

}  // namespace tessera
