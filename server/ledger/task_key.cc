#include "server/ledger/task_key.h"

#include <algorithm>

namespace tessera {

std::string TaskKey(const std::string& algorithm_version, const std::string& kind, const std::string& parameters,
                    std::vector<NamedDigest> inputs) {
  std::sort(inputs.begin(), inputs.end(), [](const NamedDigest& a, const NamedDigest& b) { return a.name < b.name; });
  Sha256Hasher hasher;
  // A length before each part makes the encoding unambiguous.
  const auto add = [&hasher](const std::string& part) { hasher.Update(std::to_string(part.size()) + ":" + part); };
  add("tessera-task");
  add(algorithm_version);
  add(kind);
  add(parameters);
  for (const NamedDigest& input : inputs) {
    add(input.name);
    add(input.digest.sha256);
  }
  return hasher.Finish();
}

}  // namespace tessera
