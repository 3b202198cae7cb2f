// Selection of elements by index.
#pragma once

#include <cstdint>
#include <vector>

#include "common/base/parallel.h"

namespace tessera {

// values[i] for each i of `indices`, in that order. Empty if `values` is empty: an empty array means "not available".
// Runs on all threads.
template <class T>
std::vector<T> Pick(const std::vector<T>& values, const std::vector<uint32_t>& indices) {
  if (values.empty()) return {};
  std::vector<T> picked(indices.size());
  ParallelForEach(indices.size(), 8192, [&](size_t i) { picked[i] = values[indices[i]]; });
  return picked;
}

}  // namespace tessera
