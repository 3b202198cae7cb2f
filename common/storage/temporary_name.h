// Unique names of temporary files.
#pragma once

#include <string>

namespace tessera {

// 128 random bits in hexadecimal, unique across processes and machines. (Process ids are not: in containers every
// process may have id 1.) Open the file with O_EXCL anyway. Thread-safe.
std::string UniqueName();

// A temporary name in the folder of `path`, for a later rename to `path`.
inline std::string TemporaryBeside(const std::string& path) { return path + ".tmp-" + UniqueName(); }

}  // namespace tessera
