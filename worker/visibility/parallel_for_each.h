// Parallel loops over single indices.
#pragma once

#include <cstdint>

#include "common/base/parallel.h"

namespace tessera {

// Calls body(i) for each i in [0, count), in any order, on the threads of the process. A thread takes chunks of
// `grain` indices (ParallelFor). `body` must not throw.
template <class Count, class Body>
void ParallelForEach(Count count, int64_t grain, const Body& body) {
  ParallelFor(static_cast<int64_t>(count), grain, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) body(i);
  });
}

}  // namespace tessera
