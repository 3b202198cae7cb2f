// The key of a task's result: the hash of all that the result depends on.
#pragma once

#include <string>
#include <vector>

#include "common/storage/hash.h"

namespace tessera {

// SHA-256 of the algorithm version, kind, parameters and the inputs' names and digests; their order does not matter.
std::string TaskKey(const std::string& algorithm_version, const std::string& kind, const std::string& parameters,
                    std::vector<NamedDigest> inputs);

}  // namespace tessera
