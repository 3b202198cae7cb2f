// Recognises the text that Git LFS leaves in place of a file whose content was not fetched:
// https://github.com/git-lfs/git-lfs/blob/main/docs/spec.md
#pragma once

#include <string>
#include <string_view>

#include "common/base/status.h"

namespace tessera {

// `head`: the file's first bytes, at least 24 if it has that many.
inline bool IsLfsPointer(std::string_view head) { return head.starts_with("version https://git-lfs"); }

inline Status LfsPointerError(const std::string& path) {
  return InputError(path, "", "a Git LFS pointer in place of the file",
                    "the file itself: run 'git lfs pull' in its repository");
}

}  // namespace tessera
