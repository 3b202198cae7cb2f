// A histogram with fixed buckets, for metrics.
#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

namespace tessera {

// Not thread-safe.
class Histogram {
 public:
  // `bounds`: ascending inclusive upper bounds of the buckets; values above the last bound go into one more bucket.
  explicit Histogram(std::vector<double> bounds) : bounds_(std::move(bounds)), counts_(bounds_.size() + 1) {}
  // NaN is counted in the last bucket and is not added to the sum.
  void Add(double value) {
    const auto not_less = [value](double bound) { return value <= bound; };
    ++counts_[std::find_if(bounds_.begin(), bounds_.end(), not_less) - bounds_.begin()];
    ++count_;
    if (value == value) sum_ += value;
  }
  const std::vector<double>& bounds() const { return bounds_; }
  const std::vector<int64_t>& counts() const { return counts_; }  // one per bucket, not cumulative
  int64_t count() const { return count_; }
  double sum() const { return sum_; }

 private:
  std::vector<double> bounds_;
  std::vector<int64_t> counts_;
  int64_t count_ = 0;
  double sum_ = 0;
};

}  // namespace tessera
