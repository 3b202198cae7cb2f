#include "common/base/parallel.h"

#include <tbb/global_control.h>
#include <tbb/info.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <thread>

namespace tessera {
namespace {

constexpr double kBatch_bytes = 256 << 20;
constexpr int kMostAtOnce = 16;

#ifdef __SANITIZE_THREAD__
// Under ThreadSanitizer, use plain threads: Debian's oneTBB is not instrumented, so every loop would be reported.
void ForEachChunk(int64_t chunks, const std::function<void(int64_t)>& run) {
  std::atomic<int64_t> next = 0;
  const auto work = [&] {
    for (int64_t chunk; (chunk = next++) < chunks;) run(chunk);
  };
  std::jthread other;
  if (chunks > 1) other = std::jthread(work);
  work();
}
#else
void ForEachChunk(int64_t chunks, const std::function<void(int64_t)>& run) {
  tbb::parallel_for(int64_t{0}, chunks, run);
}
#endif

}  // namespace

void ParallelFor(int64_t count, int64_t grain, const std::function<void(int64_t, int64_t)>& body) {
  const int64_t step = std::max<int64_t>(grain, 1);
  ForEachChunk((count + step - 1) / step,
               [&](int64_t chunk) { body(chunk * step, std::min(count, (chunk + 1) * step)); });
}

double ParallelSum(int64_t count, int64_t grain, const std::function<double(int64_t, int64_t)>& body) {
  const int64_t step = std::max<int64_t>(grain, 1);
  std::vector<double> partial((std::max<int64_t>(count, 0) + step - 1) / step);
  ParallelFor(count, step, [&](int64_t begin, int64_t end) { partial[begin / step] = body(begin, end); });
  double sum = 0;
  for (double part : partial) sum += part;
  return sum;
}

void ConcurrentForEach(int64_t count, int at_once, const std::function<void(int64_t)>& body) {
  std::atomic<int64_t> next = 0;
  const auto work = [&] {
    for (int64_t i; (i = next++) < count;) body(i);
  };
  std::vector<std::jthread> others;
  for (int64_t thread = 1; thread < std::min<int64_t>(at_once, count); ++thread) others.emplace_back(work);
  work();
}

double LargestBatch_bytes(double bytes_each) {
  return std::max(bytes_each, std::min(kBatch_bytes, kMostAtOnce * bytes_each));
}

int ItemsAtOnce(double bytes_each) {
  const int most = std::min(ThreadCount(), kMostAtOnce);
  return bytes_each * most <= kBatch_bytes ? most : std::max(1, static_cast<int>(kBatch_bytes / bytes_each));
}

int ThreadCount() {
  const auto allowed = tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism);
  return static_cast<int>(std::max<size_t>(allowed, 1));
}

struct ThreadLimit::Impl {
  tbb::global_control control;
};

ThreadLimit::ThreadLimit(int threads)
    : impl_(new Impl{tbb::global_control(tbb::global_control::max_allowed_parallelism,
                                         threads > 0 ? threads : tbb::info::default_concurrency())}) {}

ThreadLimit::~ThreadLimit() = default;

}  // namespace tessera
