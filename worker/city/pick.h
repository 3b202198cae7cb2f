// Selection of elements by index.
#pragma once

#include <cstdint>
#include <vector>

namespace tessera {

// values[i] for each i of `indices`, in that order. Empty if `values` is empty: an empty array means "not available".
template <class T>
std::vector<T> Pick(const std::vector<T>& values, const std::vector<uint32_t>& indices) {
  std::vector<T> picked;
  if (values.empty()) return picked;
  picked.reserve(indices.size());
  for (const uint32_t index : indices) picked.push_back(values[index]);
  return picked;
}

}  // namespace tessera
