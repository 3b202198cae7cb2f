// A bound on the depth of JSON from outside. Check it before parsing: the JSON library recurses once per level when it
// copies, writes or compares values, so deep input would overflow the stack.
#pragma once

#include <string>
#include <string_view>

#include "common/base/status.h"

namespace tessera {

inline constexpr int kMaxJsonDepth = 64;  // nested arrays and objects; files of this project have fewer than 10

// INVALID_ARGUMENT if arrays and objects in `text` nest deeper than kMaxJsonDepth. `what` names the text in the
// message. Does not check whether `text` is valid JSON.
Status CheckJsonDepth(const std::string& what, std::string_view text);

}  // namespace tessera
