#include "server/store/journal.h"

#include <algorithm>
#include <chrono>
#include <utility>

namespace tessera {
namespace {

constexpr size_t kMaxBatch = 4096;  // records: a wait is bounded by how long these take
constexpr std::chrono::milliseconds kFirstPause{50}, kLongestPause{1000};

}  // namespace

Journal::Journal(RecordStore* store, Options options)
    : store_(store), options_(std::move(options)), thread_([this] { Run(); }) {}

Journal::~Journal() {
  {
    std::lock_guard lock(mutex_);
    stop_ = true;
  }
  added_.notify_all();
  thread_.join();
}

int64_t Journal::Add(std::string record, Durability durability) {
  int64_t number = 0;
  {
    std::lock_guard lock(mutex_);
    waiting_.push_back({std::move(record), durability});
    number = ++last_;
  }
  added_.notify_one();
  return number;
}

int64_t Journal::last() const {
  std::lock_guard lock(mutex_);
  return last_;
}

int64_t Journal::stored() const {
  std::lock_guard lock(mutex_);
  return last_stored_;
}

Status Journal::Wait(int64_t number) const {
  std::unique_lock lock(mutex_);
  const auto limit = std::chrono::microseconds(static_cast<int64_t>(options_.wait_s * 1e6));
  if (stored_.wait_for(lock, limit, [&] { return last_stored_ >= number; })) return absl::OkStatus();
  return absl::UnavailableError("the coordinator cannot store its records now, and goes on trying: " +
                                std::string(trouble_.ok() ? "the disk is slow" : trouble_.message()));
}

Status Journal::trouble() const {
  std::lock_guard lock(mutex_);
  return trouble_;
}

void Journal::Run() {
  std::unique_lock lock(mutex_);
  while (true) {
    added_.wait(lock, [&] { return stop_ || !waiting_.empty(); });
    if (waiting_.empty()) return;
    std::vector<Entry> batch;
    if (waiting_.size() <= kMaxBatch) {
      batch.swap(waiting_);
    } else {
      const auto end = waiting_.begin() + kMaxBatch;
      batch.assign(std::make_move_iterator(waiting_.begin()), std::make_move_iterator(end));
      waiting_.erase(waiting_.begin(), end);
    }
    lock.unlock();
    const bool stored = Store(batch);
    if (stored && options_.on_stored) {
      for (const Entry& entry : batch) options_.on_stored(entry.record);
    }
    lock.lock();
    if (!stored) return;
    last_stored_ += static_cast<int64_t>(batch.size());
    stored_.notify_all();
  }
}

bool Journal::Store(const std::vector<Entry>& batch) {
  std::vector<std::string_view> records;
  Durability durability = Durability::kProcess;
  for (const Entry& entry : batch) {
    records.push_back(entry.record);
    durability = std::max(durability, entry.durability);
  }
  for (auto pause = kFirstPause;; pause = std::min(2 * pause, kLongestPause)) {
    const Status status = store_->Append(records, durability);
    std::unique_lock lock(mutex_);
    const bool changed = trouble_.ok() != status.ok();
    trouble_ = status;
    if (changed && options_.on_trouble) {
      lock.unlock();
      options_.on_trouble(status);
      lock.lock();
    }
    if (status.ok()) return true;
    if (added_.wait_for(lock, pause, [&] { return stop_; })) return false;
  }
}

}  // namespace tessera
