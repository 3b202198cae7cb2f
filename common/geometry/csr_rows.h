// Rows of unequal length in two flat arrays (compressed sparse rows).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace tessera {

// Row i is items[offsets[i]] to items[offsets[i + 1] - 1].
struct CsrRows {
  std::vector<int64_t> offsets = {0};
  std::vector<uint32_t> items;
  size_t size() const { return offsets.size() - 1; }
  std::span<const uint32_t> operator[](size_t row) const {
    return {items.data() + offsets[row], static_cast<size_t>(offsets[row + 1] - offsets[row])};
  }
};

}  // namespace tessera
