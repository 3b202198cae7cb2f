// Groups of tasks by kind and class of memory, for metrics.
#pragma once

#include <algorithm>
#include <array>
#include <compare>
#include <cstdint>

#include "common/job/task_kinds.h"

namespace tessera {

// Upper bound of each class in GiB. Two more classes follow: larger tasks, and tasks without a prediction.
inline constexpr std::array<int, 7> kMemoryClasses_GiB = {1, 2, 4, 8, 16, 32, 64};
inline constexpr int kUnknownMemoryClass = static_cast<int>(kMemoryClasses_GiB.size()) + 1;

inline int MemoryClass(int64_t peak_bytes) {
  if (peak_bytes <= 0) return kUnknownMemoryClass;
  const auto fits = [peak_bytes](int gib) { return peak_bytes <= int64_t{gib} << 30; };
  return static_cast<int>(std::find_if(kMemoryClasses_GiB.begin(), kMemoryClasses_GiB.end(), fits) -
                          kMemoryClasses_GiB.begin());
}

struct TaskGroup {
  int kind = 0;          // index in kTaskKinds, see KindIndex
  int memory_class = 0;  // MemoryClass
  friend auto operator<=>(const TaskGroup&, const TaskGroup&) = default;
};

}  // namespace tessera
