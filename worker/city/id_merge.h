// Merges many ascending lists of ids.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <queue>
#include <span>
#include <vector>

namespace tessera {

// The first index after `k` with values[index] >= value, or the size. `values` ascends, values[k] < value. Takes few
// steps if the index is near.
inline size_t NextNotBelow(std::span<const uint32_t> values, size_t k, uint32_t value) {
  if (++k == values.size() || values[k] >= value) return k;
  size_t step = 1;
  while (k + step < values.size() && values[k + step] < value) {
    k += step;
    step *= 2;
  }
  const auto end = values.begin() + static_cast<ptrdiff_t>(std::min(values.size(), k + step));
  return static_cast<size_t>(std::lower_bound(values.begin() + static_cast<ptrdiff_t>(k), end, value) - values.begin());
}

// Calls found(i, k) for each some[i] == all[k]. Both ascend. Skips what only one of them has: a tile's ids are a small
// part of a package's.
template <class Found>
void ForSharedIds(std::span<const uint32_t> some, std::span<const uint32_t> all, const Found& found) {
  size_t i = 0, k = 0;
  while (i < some.size() && k < all.size()) {
    if (some[i] == all[k]) {
      found(i, k);
      ++i;  // the next one may be equal
    } else if (all[k] < some[i]) {
      k = NextNotBelow(all, k, some[i]);
    } else {
      i = NextNotBelow(some, i, all[k]);
    }
  }
}

// Iterates over the elements of all lists, ordered by key, then by list. `Key` is an unsigned integer. The lists must
// be ascending and outlive the object. Each list is read sequentially, so lists may be mapped files. Not thread-safe.
template <class Key>
class IdMerge {
 public:
  explicit IdMerge(std::vector<std::span<const Key>> lists) : lists_(std::move(lists)), index_(lists_.size(), 0) {
    for (size_t i = 0; i < lists_.size(); ++i) Push(i);
    Pop();
  }
  bool AtEnd() const { return list_ == lists_.size(); }
  Key key() const { return lists_[list_][index_[list_]]; }
  size_t list() const { return list_; }
  size_t index() const { return index_[list_]; }
  void Advance() {
    ++index_[list_];
    // Fast path: consecutive keys mostly come from the same list.
    if (index_[list_] < lists_[list_].size() && (heap_.empty() || Head{key(), list_} < heap_.top())) return;
    Push(list_);
    Pop();
  }

 private:
  struct Head {
    Key key;
    size_t list;
    bool operator<(const Head& o) const { return key != o.key ? key < o.key : list < o.list; }
    bool operator>(const Head& o) const { return o < *this; }
  };
  void Push(size_t list) {
    if (index_[list] < lists_[list].size()) heap_.push({lists_[list][index_[list]], list});
  }
  void Pop() {
    list_ = lists_.size();
    if (heap_.empty()) return;
    list_ = heap_.top().list;
    heap_.pop();
  }

  std::vector<std::span<const Key>> lists_;
  std::vector<size_t> index_;                                              // position in each list
  std::priority_queue<Head, std::vector<Head>, std::greater<Head>> heap_;  // of all lists except the current one
  size_t list_ = 0;                                                        // current list; lists_.size() at the end
};

}  // namespace tessera
