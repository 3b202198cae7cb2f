// Answers that many pages ask for again and again.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>

#include "common/base/status.h"
#include "server/http/gzip.h"

namespace tessera {

// JSON with its ETag. Thread-safe.
class SharedAnswer {
 public:
  // `etag`: without quotes; empty: a hash of the JSON.
  SharedAnswer(std::string json, std::string etag);
  const std::string& json() const { return json_; }
  const std::string& etag() const { return etag_; }
  // The JSON, compressed when it is first asked for; empty if that is of no use.
  const std::string& gzip() const;
  // The JSON as a part of streams, compressed when it is first asked for.
  const GzipPart& part() const;
  // Of the compressed JSON if it is there, else of the JSON. Takes no time.
  size_t packed_bytes() const;

 private:
  const std::string json_, etag_;
  mutable std::once_flag packed_;
  mutable std::string gzip_;
  mutable std::atomic<bool> has_gzip_ = false;
  mutable std::once_flag parted_;
  mutable std::optional<GzipPart> part_;
};

// An answer is made at most once in kAge, for all who ask meanwhile; the caller has checked that they may. One that
// took long is kept longer, so that answers to pages that poll take no more than a small share of a processor.
// Thread-safe.
class SharedAnswers {
 public:
  using Clock = std::chrono::steady_clock;
  using Answer = std::shared_ptr<const SharedAnswer>;
  static constexpr std::chrono::milliseconds kAge{400}, kMaxAge{3000};
  static constexpr int kAgeOfCost = 50;  // an answer is kept for as many times as it took, within these limits
  static constexpr size_t kMaxBytes = size_t{64} << 20;
  static constexpr size_t kMaxAnswers = 1000;

  // How long an answer is kept that took `cost` to make.
  static std::chrono::milliseconds AgeOf(Clock::duration cost);
  // The answer for `key`. Calls `make` if there is none that is new enough and no other thread makes it. Errors of
  // `make` are returned to all who wait for it.
  StatusOr<Answer> Get(const std::string& key, const std::function<StatusOr<Answer>()>& make);
  // The answer if it is there and new enough, else null.
  Answer Find(const std::string& key);

 private:
  struct Entry {
    std::string key;
    Clock::time_point until;
    StatusOr<Answer> answer = Answer();
    bool making = false;
    size_t bytes = 0;
  };
  void DropOldLocked(Clock::time_point now);

  std::mutex mutex_;
  std::condition_variable made_;
  std::list<std::shared_ptr<Entry>> order_;  // oldest first; none that is being made
  std::unordered_map<std::string, std::shared_ptr<Entry>> entries_;
  size_t bytes_ = 0;
};

}  // namespace tessera
