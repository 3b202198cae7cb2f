#include "worker/photo/view_schedule.h"

#include <algorithm>
#include <numeric>

namespace tessera {
namespace {

constexpr int kViewsPerThread = 2;   // that are opened together
constexpr int kStripsPerThread = 4;  // that are evaluated together: they take unequal times

}  // namespace

ViewSchedule::ViewSchedule(const std::vector<ViewPair>& pairs, size_t views, double ahead_bytes)
    : pairs_(views), opening_(views), closing_(views), ahead_bytes_(ahead_bytes) {
  std::iota(opening_.begin(), opening_.end(), size_t{0});
  first_step_ = opening_;
  std::vector<size_t> last_step = opening_;
  for (size_t first = 0; first < pairs.size();) {
    const auto step = static_cast<size_t>(pairs[first].reference);
    size_t last = first;
    for (; last < pairs.size() && pairs[last].reference == pairs[first].reference; ++last) {
      const auto other = static_cast<size_t>(pairs[last].other);
      first_step_[other] = std::min(first_step_[other], step);
      last_step[other] = std::max(last_step[other], step);
    }
    pairs_[step] = std::span(pairs).subspan(first, last - first);
    first = last;
  }
  std::stable_sort(opening_.begin(), opening_.end(),
                   [&](size_t a, size_t b) { return first_step_[a] < first_step_[b]; });
  for (size_t v = 0; v < views; ++v) closing_[last_step[v]].push_back(v);
}

std::vector<size_t> ViewSchedule::Open(size_t step, int threads, const std::function<double(size_t)>& bytes) {
  std::vector<size_t> open;
  if (opened_ == opening_.size() || first_step_[opening_[opened_]] > step) return open;
  const size_t most = static_cast<size_t>(kViewsPerThread) * static_cast<size_t>(threads);
  double ahead_bytes = 0;
  for (; opened_ < opening_.size(); ++opened_) {
    const size_t view = opening_[opened_];
    if (first_step_[view] > step) {
      ahead_bytes += bytes(view);
      if (open.size() >= most || ahead_bytes > ahead_bytes_) break;
    }
    open.push_back(view);
  }
  return open;
}

size_t ViewSchedule::EndOfBatch(size_t step, int threads, const std::function<int(size_t)>& strips,
                                double bytes_each) const {
  const int64_t enough = static_cast<int64_t>(kStripsPerThread) * threads;
  int64_t together = strips(step);
  double bytes = 0;
  size_t end = step + 1;
  for (; end < opening_.size() && together < enough; ++end) {
    if (opened_ < opening_.size() && first_step_[opening_[opened_]] <= end) break;  // a view of it is not open
    const int more = strips(end);
    if (more > 0) bytes += bytes_each;
    if (bytes > ahead_bytes_) break;
    together += more;
  }
  return end;
}

}  // namespace tessera
