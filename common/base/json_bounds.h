// A bound on JSON from outside, to be checked before it is parsed: values are copied, written and compared by functions
// that call themselves once a level, and a deep one would overflow the stack.
#ifndef TESSERA_COMMON_BASE_JSON_BOUNDS_H_
#define TESSERA_COMMON_BASE_JSON_BOUNDS_H_

#include <string>
#include <string_view>

#include "common/base/status.h"

namespace tessera {

inline constexpr int kMaxJsonDepth = 64;  // arrays and objects inside each other; ours have less than ten

// INVALID_ARGUMENT if arrays and objects nest deeper than kMaxJsonDepth in `text`, which errors call `what`. Whether it
// is JSON at all is the parser's to say.
Status CheckJsonDepth(const std::string& what, std::string_view text);

}  // namespace tessera

#endif  // TESSERA_COMMON_BASE_JSON_BOUNDS_H_
