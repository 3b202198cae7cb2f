#include "worker/photo/view_schedule.h"

#include <algorithm>
#include <numeric>

namespace tessera {
namespace {

constexpr int kStripsPerThread = 4;  // that are evaluated together: they take unequal times

// A thread opens a view of the next references in about the time that all strips of a reference take. With two threads
// one opens a view while the other evaluates a reference. Many threads need about two references each: views take
// unequal times, and the loop ends with the longest.
int64_t ReferencesAtOnce(int threads) { return std::max(1, 2 * threads - 3); }

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

std::vector<size_t> ViewSchedule::OpenWithin(size_t step, size_t bounded, const ReferenceWork& work,
                                             const std::function<double(size_t)>& bytes) {
  const size_t end = EndOfBatch(step, work, opening_.size());
  std::vector<size_t> open;
  double ahead_bytes = 0;
  for (size_t i = opened_; i > 0 && first_step_[opening_[i - 1]] >= std::max(step, bounded); --i) {
    ahead_bytes += bytes(opening_[i - 1]);  // open already, but not needed yet
  }
  for (; FirstNotOpen() < end; ++opened_) {
    const size_t view = opening_[opened_];
    if (first_step_[view] >= bounded) ahead_bytes += bytes(view);
    if (ahead_bytes > ahead_bytes_) break;
    open.push_back(view);
  }
  return open;
}

size_t ViewSchedule::EndOfBatch(size_t step, const ReferenceWork& work, size_t limit) const {
  int64_t strips = 0, references = 0;
  const auto add = [&](size_t reference) {
    const int more = work.strips(reference);
    strips += more;
    if (more > 0) ++references;
  };
  add(step);
  size_t end = step + 1;
  for (; end < limit; ++end) {
    if (strips >= kStripsPerThread * work.threads && references >= ReferencesAtOnce(work.threads)) break;
    if (work.strips(end) > 0 && work.bytes_each * references > ahead_bytes_) break;
    add(end);
  }
  return end;
}

}  // namespace tessera
