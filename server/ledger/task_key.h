// The name of a task's result: the hash of everything that the task reads.
#pragma once

#include <string>
#include <vector>

#include "common/storage/hash.h"

namespace tessera {

// SHA-256 over the version of the algorithms, kind, parameters and the inputs' names and digests (in any order).
std::string TaskKey(const std::string& algorithm_version, const std::string& kind, const std::string& parameters,
                    std::vector<NamedDigest> inputs);

}  // namespace tessera
