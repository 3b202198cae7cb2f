// Selects indices on all threads.
#pragma once

#include <cstdint>
#include <vector>

#include "common/base/parallel.h"

namespace tessera {

// The indices of [0, count) for which test(index) is true, ascending. `test` is called once for each.
template <class Test>
std::vector<uint32_t> IndicesWhere(size_t count, int64_t grain, const Test& test) {
  std::vector<std::vector<uint32_t>> parts((count + static_cast<size_t>(grain) - 1) / static_cast<size_t>(grain));
  ParallelFor(static_cast<int64_t>(count), grain, [&](int64_t begin, int64_t end) {
    std::vector<uint32_t>& part = parts[static_cast<size_t>(begin / grain)];
    for (auto i = static_cast<uint32_t>(begin); i < static_cast<uint32_t>(end); ++i) {
      if (test(i)) part.push_back(i);
    }
  });
  std::vector<uint32_t> all;
  for (const std::vector<uint32_t>& part : parts) all.insert(all.end(), part.begin(), part.end());
  return all;
}

}  // namespace tessera
