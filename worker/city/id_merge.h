// Merges many ascending lists of ids.
#pragma once

#include <cstdint>
#include <functional>
#include <queue>
#include <span>
#include <vector>

namespace tessera {

// Calls found(i, k) for each some[i] == all[k]. Both ascend.
template <class Found>
void ForSharedIds(std::span<const uint32_t> some, std::span<const uint32_t> all, const Found& found) {
  size_t k = 0;
  for (size_t i = 0; i < some.size(); ++i) {
    while (k < all.size() && all[k] < some[i]) ++k;
    if (k == all.size()) return;
    if (all[k] == some[i]) found(i, k);
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
