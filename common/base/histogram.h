// How often values were how large.
#ifndef TESSERA_COMMON_BASE_HISTOGRAM_H_
#define TESSERA_COMMON_BASE_HISTOGRAM_H_

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

namespace tessera {

// Not thread-safe.
class Histogram {
 public:
  // `bounds`: ascending, each the largest value of its bucket; what is above the last has one of its own.
  explicit Histogram(std::vector<double> bounds) : bounds_(std::move(bounds)), counts_(bounds_.size() + 1) {}
  // A value that is not a number counts as one above all bounds, and adds nothing to the sum.
  void Add(double value) {
    const auto not_less = [value](double bound) { return value <= bound; };
    ++counts_[std::find_if(bounds_.begin(), bounds_.end(), not_less) - bounds_.begin()];
    ++count_;
    if (value == value) sum_ += value;
  }
  const std::vector<double>& bounds() const { return bounds_; }
  const std::vector<int64_t>& counts() const { return counts_; }  // of each bucket, not cumulative
  int64_t count() const { return count_; }
  double sum() const { return sum_; }

 private:
  std::vector<double> bounds_;
  std::vector<int64_t> counts_;
  int64_t count_ = 0;
  double sum_ = 0;
};

}  // namespace tessera

#endif  // TESSERA_COMMON_BASE_HISTOGRAM_H_
