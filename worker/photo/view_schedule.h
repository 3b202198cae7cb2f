// When the data term opens and closes views, and which references it evaluates together: many enough for all threads,
// few enough for the memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "worker/photo/pairs.h"

namespace tessera {

// Step i processes reference i. A view is open from the first step that reads it to the last.
class ViewSchedule {
 public:
  ViewSchedule() = default;
  // `pairs`: sorted by reference; must outlive the object. `views`: their number. `ahead_bytes`: bound on the memory of
  // views that are open although no reference needs them yet, and on that of references that are evaluated together
  // beside the first.
  ViewSchedule(const std::vector<ViewPair>& pairs, size_t views, double ahead_bytes);

  // The views to open before reference `step`, in the order of first use: none if those that it needs are open; else
  // these and some that later references need, so that two views per thread are opened together if `bytes` (of a view
  // while it is open) permits.
  std::vector<size_t> Open(size_t step, int threads, const std::function<double(size_t view)>& bytes);
  // The views that reference `step` is the last to need.
  const std::vector<size_t>& Close(size_t step) const { return closing_[step]; }

  // References [step, the result) are to be evaluated together: the first, and later ones whose views are open, until
  // there are a few strips for each thread. `strips`: of a view as a reference; 0: it is none. `bytes_each`: of a
  // reference while it is evaluated.
  size_t EndOfBatch(size_t step, int threads, const std::function<int(size_t view)>& strips, double bytes_each) const;

  // Of this reference.
  std::span<const ViewPair> pairs(size_t reference) const { return pairs_[reference]; }

 private:
  std::vector<std::span<const ViewPair>> pairs_;  // per reference
  std::vector<size_t> opening_;                   // views ordered by first step
  std::vector<size_t> first_step_;                // per view
  std::vector<std::vector<size_t>> closing_;      // per step: views whose last step it is
  size_t opened_ = 0;                             // how many views of `opening_` have been opened
  double ahead_bytes_ = 0;
};

}  // namespace tessera
