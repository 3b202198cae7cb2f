// Sorts on all threads.
#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "common/base/parallel.h"

namespace tessera {

// Sorts ascending, by chunks that are then merged. Equal elements keep their order.
template <class T>
void ParallelSort(std::vector<T>* values, int64_t grain = 8192) {
  const auto count = static_cast<int64_t>(values->size());
  ParallelFor(count, grain, [&](int64_t begin, int64_t end) {
    std::stable_sort(values->begin() + begin, values->begin() + end);
  });
  std::vector<T> merged(count > grain ? values->size() : 0);
  for (int64_t width = grain; width < count; width *= 2) {
    ParallelFor(count, 2 * width, [&](int64_t begin, int64_t end) {
      const auto first = values->cbegin() + begin, middle = values->cbegin() + std::min(end, begin + width);
      std::merge(first, middle, middle, values->cbegin() + end, merged.begin() + begin);
    });
    std::swap(*values, merged);
  }
}

}  // namespace tessera
