#include "server/http/shared_answers.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "common/storage/hash.h"

namespace tessera {
namespace {

constexpr size_t kLeastPackedBytes = 1 << 10;

}  // namespace

SharedAnswer::SharedAnswer(std::string json, std::string etag)
    : json_(std::move(json)), etag_(etag.empty() ? Xxh3Hex(json_.data(), json_.size()) : std::move(etag)) {}

const std::string& SharedAnswer::gzip() const {
  std::call_once(packed_, [this] {
    if (json_.size() >= kLeastPackedBytes) gzip_ = Gzip(json_);
    has_gzip_ = !gzip_.empty();
  });
  return gzip_;
}

const GzipPart& SharedAnswer::part() const {
  std::call_once(parted_, [this] { part_.emplace(json_); });
  return *part_;
}

size_t SharedAnswer::packed_bytes() const { return has_gzip_ ? gzip_.size() : json_.size(); }

std::chrono::milliseconds SharedAnswers::AgeOf(Clock::duration cost) {
  return std::clamp(std::chrono::duration_cast<std::chrono::milliseconds>(kAgeOfCost * cost), kAge, kMaxAge);
}

StatusOr<SharedAnswers::Answer> SharedAnswers::Get(const std::string& key,
                                                   const std::function<StatusOr<Answer>()>& make) {
  std::shared_ptr<Entry> entry;
  {
    std::unique_lock lock(mutex_);
    DropOldLocked(Clock::now());
    if (const auto found = entries_.find(key); found != entries_.end()) {
      entry = found->second;
      made_.wait(lock, [&] { return !entry->making; });
      return entry->answer;
    }
    entry = std::make_shared<Entry>();
    entry->key = key;
    entry->making = true;
    entries_[key] = entry;
  }
  const Clock::time_point begun = Clock::now();
  StatusOr<Answer> made = make();
  std::lock_guard lock(mutex_);
  entry->making = false;
  const Clock::time_point now = Clock::now();
  entry->until = now + AgeOf(now - begun);
  // A compressed copy is much smaller.
  if (made.ok()) entry->bytes = (*made)->json().size() + key.size();
  entry->answer = std::move(made);
  bytes_ += entry->bytes;
  order_.push_back(entry);
  made_.notify_all();
  return entry->answer;
}

SharedAnswers::Answer SharedAnswers::Find(const std::string& key) {
  std::lock_guard lock(mutex_);
  DropOldLocked(Clock::now());
  const auto found = entries_.find(key);
  if (found == entries_.end() || found->second->making || !found->second->answer.ok()) return nullptr;
  return *found->second->answer;
}

void SharedAnswers::DropOldLocked(Clock::time_point now) {
  for (auto entry = order_.begin(); entry != order_.end();) {
    const auto next = std::next(entry);
    if (now > (*entry)->until || bytes_ > kMaxBytes || order_.size() > kMaxAnswers) {
      bytes_ -= (*entry)->bytes;
      entries_.erase((*entry)->key);
      order_.erase(entry);
    }
    entry = next;
  }
}

}  // namespace tessera
