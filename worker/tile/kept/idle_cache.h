// Objects of earlier tasks that later tasks use again, within a bound on their memory.
#pragma once

#include <algorithm>
#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>
#include <utility>

namespace tessera {

// Tasks use the objects in turn: all tiles of a worker, then all of them again. If not all objects fit, dropping the
// least recently used one would drop each of them before its next use. So the most recently used one is dropped, unless
// some were not used since the object that is taken was taken last: these are dropped first. Thread-safe.
template <class T>
class IdleCache {
 public:
  // `limit_bytes`: of the objects that stay while another one is used.
  explicit IdleCache(size_t limit_bytes) : limit_bytes_(limit_bytes) {}

  // Takes the object out; null if there is none. Drops others down to the limit, also if there is none: call it before
  // the object is made.
  std::unique_ptr<T> Take(const std::string& key) {
    std::list<Idle> dropped;  // destroyed after the lock is released
    const std::lock_guard lock(mutex_);
    std::unique_ptr<T> object;
    const auto found = std::find_if(idle_.begin(), idle_.end(), [&](const Idle& idle) { return idle.key == key; });
    if (found != idle_.end()) {
      object = std::move(found->object);
      idle_.erase(found);
    }
    if (taken_.size() >= kMostKeys) taken_.clear();
    int64_t& taken = taken_[key];
    Drop(taken, &dropped);
    taken = ++now_;
    return object;
  }

  // May exceed the limit by this object until the next call of Take or Trim.
  void Put(const std::string& key, std::unique_ptr<T> object, size_t bytes) {
    const std::lock_guard lock(mutex_);
    idle_.push_front({key, std::move(object), bytes, ++now_});
  }

  // Drops objects down to the limit, the least recently used ones first.
  void Trim() {
    std::list<Idle> dropped;
    const std::lock_guard lock(mutex_);
    Drop(0, &dropped);
  }

 private:
  static constexpr size_t kMostKeys = 4096;
  struct Idle {
    std::string key;
    std::unique_ptr<T> object;
    size_t bytes;
    int64_t used;
  };

  // `since`: objects not used since then are dropped first; 0: unknown.
  void Drop(int64_t since, std::list<Idle>* dropped) {
    size_t bytes = 0;
    for (const Idle& idle : idle_) bytes += idle.bytes;
    while (bytes > limit_bytes_) {
      const bool oldest = since == 0 || idle_.back().used < since;
      const auto at = oldest ? std::prev(idle_.end()) : idle_.begin();
      bytes -= at->bytes;
      dropped->splice(dropped->end(), idle_, at);
    }
  }

  const size_t limit_bytes_;
  std::mutex mutex_;
  int64_t now_ = 0;
  std::list<Idle> idle_;                            // most recently used first
  std::unordered_map<std::string, int64_t> taken_;  // when each key was taken last
};

}  // namespace tessera
