// Parallel loops over fixed chunks. Sums reduced chunk by chunk do not depend on the number of threads.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

namespace tessera {

// Calls body(begin, end) for the chunks [0, grain), [grain, 2 grain), ... of [0, count), in any order, on the threads
// of the process. The chunks are the same for every number of threads. `body` must not throw.
void ParallelFor(int64_t count, int64_t grain, const std::function<void(int64_t begin, int64_t end)>& body);

// Calls body(i) for every i of [0, count), in the same chunks; within a chunk in ascending order.
template <class Index, class Body>
void ParallelForEach(Index count, int64_t grain, const Body& body) {
  ParallelFor(static_cast<int64_t>(count), grain, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) body(static_cast<Index>(i));
  });
}

// Sum of body(begin, end) over the same chunks, added in the order of the chunks: bit-identical for every number of
// threads.
double ParallelSum(int64_t count, int64_t grain, const std::function<double(int64_t begin, int64_t end)>& body);

// Calls body(i) for every i of [0, count), in ascending order of their starts, on the calling thread and at most
// `at_once` - 1 others, which end before the call returns. For bodies that wait for a disk or a network; ParallelFor is
// for computation. `body` must not throw.
void ConcurrentForEach(int64_t count, int at_once, const std::function<void(int64_t i)>& body);

// The number of threads that ParallelFor may use now; at least 1.
int ThreadCount();

// For loops over large items, such as images: how many to hold in memory at once. One per thread, at most 64, and no
// more than fit LookaheadLimit_bytes; at least one.
int ItemsAtOnce(double bytes_each);

// Limits the threads of ParallelFor in the whole process for the lifetime of the object; 0: one per core.
class ThreadLimit {
 public:
  explicit ThreadLimit(int threads);
  ~ThreadLimit();
  ThreadLimit(const ThreadLimit&) = delete;
  ThreadLimit& operator=(const ThreadLimit&) = delete;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera
