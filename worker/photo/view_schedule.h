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

// What the evaluation of references takes.
struct ReferenceWork {
  int threads = 1;                         // that they are divided among
  std::function<int(size_t view)> strips;  // of a view as a reference; 0: it is none
  double bytes_each = 0;                   // memory of a reference while it is evaluated
};

// Step i processes reference i. A view is open from the first step that reads it to the last.
class ViewSchedule {
 public:
  ViewSchedule() = default;
  // `pairs`: sorted by reference; must outlive the object. `views`: their number. `ahead_bytes`: bound on the memory of
  // views that are open although no reference needs them yet, and on that of references that are evaluated together
  // beside the first.
  ViewSchedule(const std::vector<ViewPair>& pairs, size_t views, double ahead_bytes);

  // The views to open before reference `step`, in the order of first use: none if those that it needs are open; else
  // these, and within the bound those of later references that would be evaluated together with it. They are open from
  // now on. `bytes`: of a view while it is open.
  std::vector<size_t> Open(size_t step, const ReferenceWork& work, const std::function<double(size_t view)>& bytes) {
    return FirstNotOpen() > step ? std::vector<size_t>() : OpenWithin(step, step + 1, work, bytes);
  }
  // The views to open while references before `step` are evaluated: those of `step` and of the references that would be
  // evaluated together with it, all of them within the bound. The next call is Open(step, ...).
  std::vector<size_t> OpenAhead(size_t step, const ReferenceWork& work,
                                const std::function<double(size_t view)>& bytes) {
    return OpenWithin(step, 0, work, bytes);
  }
  // The views that reference `step` is the last to need.
  const std::vector<size_t>& Close(size_t step) const { return closing_[step]; }

  // References [step, the result) are to be evaluated together: the first, and later ones whose views are open, until
  // all threads have work while the views of the next ones are opened.
  size_t EndOfBatch(size_t step, const ReferenceWork& work) const { return EndOfBatch(step, work, FirstNotOpen()); }

  // Of this reference.
  std::span<const ViewPair> pairs(size_t reference) const { return pairs_[reference]; }

 private:
  // The first reference that needs a view that is not open; or the number of views.
  size_t FirstNotOpen() const { return opened_ < opening_.size() ? first_step_[opening_[opened_]] : opening_.size(); }
  // The bound is for the views that no reference before `bounded` needs.
  std::vector<size_t> OpenWithin(size_t step, size_t bounded, const ReferenceWork& work,
                                 const std::function<double(size_t view)>& bytes);
  // At most `limit`.
  size_t EndOfBatch(size_t step, const ReferenceWork& work, size_t limit) const;

  std::vector<std::span<const ViewPair>> pairs_;  // per reference
  std::vector<size_t> opening_;                   // views ordered by first step
  std::vector<size_t> first_step_;                // per view
  std::vector<std::vector<size_t>> closing_;      // per step: views whose last step it is
  size_t opened_ = 0;                             // how many views of `opening_` have been opened
  double ahead_bytes_ = 0;
};

}  // namespace tessera
