// Names of files that are written first and renamed later.
#pragma once

#include <string>

namespace tessera {

// 128 random bits of the system's in hexadecimal: a name that no other process has, on this machine or another,
// whatever its number. (In containers every process is number 1.) Still to be opened with O_EXCL. Thread-safe.
std::string UniqueName();

// A name in the folder of `path`, for what is to be renamed to `path`.
inline std::string TemporaryBeside(const std::string& path) { return path + ".tmp-" + UniqueName(); }

}  // namespace tessera
