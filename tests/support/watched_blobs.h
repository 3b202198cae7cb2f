// A blob store whose calls can be held, and which records the threads and locks that they are made with.
#pragma once

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/storage/blob_store.h"

namespace tessera {

// Passes all calls on to another store. Location and LocalPath ask no store, so they are neither held nor counted.
// Thread-safe.
class WatchedBlobs final : public BlobStore {
 public:
  explicit WatchedBlobs(BlobStore* blobs) : blobs_(blobs) {}
  ~WatchedBlobs() override { Release(); }

  // Calls of the thread during this object's life count as calls of a thread that answers callers.
  class Answering {
   public:
    Answering() { ++depth_; }
    ~Answering() { --depth_; }

   private:
    friend class WatchedBlobs;
    static inline thread_local int depth_ = 0;
  };
  // Counts calls by threads that hold the mutex.
  void Watch(std::mutex* mutex) { watched_ = mutex; }

  // From now on calls wait for Release, except the first `passing` ones.
  void Hold(int passing = 0) {
    std::lock_guard lock(mutex_);
    holds_ = true;
    passing_ = passing;
  }
  void Release() {
    std::lock_guard lock(mutex_);
    holds_ = false;
    changed_.notify_all();
  }
  // Waits until so many calls are held; false after 20 s.
  bool AwaitHeld(int calls) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, std::chrono::seconds(20), [&] { return open_ >= calls; });
  }
  // Stat gives this status, unless it is OK.
  void AnswerStatsWith(const Status& status) {
    std::lock_guard lock(mutex_);
    stat_ = status;
  }

  int calls() const { return Get(calls_); }
  int most_at_once() const { return Get(most_open_); }
  int calls_under_mutex() const { return Get(under_mutex_); }
  int calls_while_answering() const { return Get(while_answering_); }

  Status Stat(const Digest& digest) const override {
    const Call call(*this);
    const Status told = Get(stat_);
    return told.ok() ? blobs_->Stat(digest) : told;
  }
  StatusOr<std::string> ReadRange(const Digest& digest, int64_t offset_bytes, int64_t size_bytes) const override {
    const Call call(*this);
    return blobs_->ReadRange(digest, offset_bytes, size_bytes);
  }
  Status Verify(const Digest& digest) const override {
    const Call call(*this);
    return blobs_->Verify(digest);
  }
  Status VerifyOrQuarantine(const Digest& digest) override {
    const Call call(*this);
    return blobs_->VerifyOrQuarantine(digest);
  }
  StatusOr<Digest> PutFile(const std::string& path) override {
    const Call call(*this);
    return blobs_->PutFile(path);
  }
  StatusOr<Digest> MoveFile(const std::string& path) override {
    const Call call(*this);
    return blobs_->MoveFile(path);
  }
  StatusOr<Digest> PutBytes(const std::string& bytes) override {
    const Call call(*this);
    return blobs_->PutBytes(bytes);
  }
  StatusOr<Digest> PutParts(const std::function<void(const Writer& write)>& give) override {
    const Call call(*this);
    return blobs_->PutParts(give);
  }
  Status Touch(const Digest& digest) override {
    const Call call(*this);
    return blobs_->Touch(digest);
  }
  StatusOr<int64_t> CommittedBytes(const Digest& digest) const override {
    const Call call(*this);
    return blobs_->CommittedBytes(digest);
  }
  StatusOr<int64_t> Append(const Digest& digest, int64_t offset, const std::string& bytes) override {
    const Call call(*this);
    return blobs_->Append(digest, offset, bytes);
  }
  Status Complete(const Digest& digest) override {
    const Call call(*this);
    return blobs_->Complete(digest);
  }
  StatusOr<std::vector<BlobEntry>> List(int part) const override {
    const Call call(*this);
    return blobs_->List(part);
  }
  StatusOr<FreeBytes> Remove(const BlobEntry& entry) override {
    const Call call(*this);
    return blobs_->Remove(entry);
  }
  std::optional<int64_t> FreeSpace() const override {
    const Call call(*this);
    return blobs_->FreeSpace();
  }
  std::string Location() const override { return blobs_->Location(); }
  std::optional<std::string> LocalPath(const Digest& digest) const override { return blobs_->LocalPath(digest); }

 private:
  // The owner that glibc notes in a mutex.
  static bool IsHeldByThisThread(std::mutex& mutex) { return mutex.native_handle()->__data.__owner == ::gettid(); }

  class Call {
   public:
    explicit Call(const WatchedBlobs& store) : store_(store) {
      std::unique_lock lock(store_.mutex_);
      ++store_.calls_;
      if (store_.watched_ != nullptr && IsHeldByThisThread(*store_.watched_)) ++store_.under_mutex_;
      if (Answering::depth_ > 0) ++store_.while_answering_;
      store_.most_open_ = std::max(store_.most_open_, ++store_.open_);
      store_.changed_.notify_all();
      if (store_.passing_-- > 0) return;
      store_.changed_.wait(lock, [&] { return !store_.holds_; });
    }
    ~Call() {
      std::lock_guard lock(store_.mutex_);
      --store_.open_;
    }

   private:
    const WatchedBlobs& store_;
  };
  template <class T>
  T Get(const T& value) const {
    std::lock_guard lock(mutex_);
    return value;
  }

  BlobStore* const blobs_;
  std::mutex* watched_ = nullptr;
  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;
  bool holds_ = false;
  Status stat_;
  mutable int passing_ = 0, calls_ = 0, open_ = 0, most_open_ = 0, under_mutex_ = 0, while_answering_ = 0;
};

}  // namespace tessera
