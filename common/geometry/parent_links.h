// Union-find over indices.
#pragma once

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <vector>

namespace tessera {

// The representative of a set is its lowest member.
class ParentLinks {
 public:
  explicit ParentLinks(size_t size) : parent_(size) { std::iota(parent_.begin(), parent_.end(), 0u); }
  uint32_t Find(uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void Join(uint32_t i, uint32_t j) {
    i = Find(i);
    j = Find(j);
    parent_[std::max(i, j)] = std::min(i, j);
  }
  std::vector<uint32_t> Flattened() {
    for (uint32_t i = 0; i < parent_.size(); ++i) parent_[i] = parent_[parent_[i]];  // a parent has a lower index
    return std::move(parent_);
  }

 private:
  std::vector<uint32_t> parent_;
};

}  // namespace tessera
