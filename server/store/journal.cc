#include "server/store/journal.h"

#include <algorithm>
#include <chrono>
#include <future>
#include <iterator>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/store/state_store.h"

namespace tessera {
namespace {

constexpr size_t kMaxBatch = 4096;  // records; bounds the time of one transaction
constexpr std::chrono::milliseconds kFirstPause{50}, kLongestPause{1000};

}  // namespace

Journal::Journal(RecordStore* store, Options options)
    : store_(store), options_(std::move(options)), thread_([this] { Run(); }), waits_thread_([this] { EndWaits(); }) {}

Journal::~Journal() {
  {
    std::lock_guard lock(mutex_);
    stop_ = true;
  }
  added_.notify_all();
  thread_.join();
  {
    std::lock_guard lock(mutex_);
    ended_ = true;
  }
  stored_.notify_all();
  waits_thread_.join();
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

Status Journal::OutcomeLocked(int64_t number) const {
  if (!taken_over_.ok()) return taken_over_;
  if (number <= last_stored_) return absl::OkStatus();
  return absl::UnavailableError(absl::StrCat("unavailable: the coordinator cannot write its journal and keeps trying: ",
                                             trouble_.ok() ? "the disk is slow" : trouble_.message()));
}

int64_t Journal::stored() const {
  std::lock_guard lock(mutex_);
  return last_stored_;
}

Status Journal::Wait(int64_t number) const {
  const auto stored = std::make_shared<std::promise<Status>>();
  WhenStored(number, [stored](Status status) { stored->set_value(std::move(status)); });
  return stored->get_future().get();
}

void Journal::WhenStored(Done done) const { WhenStored(last(), std::move(done)); }

void Journal::WhenStored(int64_t number, Done done) const {
  Status outcome;
  {
    std::lock_guard lock(mutex_);
    if (last_stored_ < number && taken_over_.ok()) {
      const auto limit = std::chrono::microseconds(static_cast<int64_t>(options_.wait_s * 1e6));
      waiters_.push_back({number, std::chrono::steady_clock::now() + limit, std::move(done)});
      if (waiters_.size() == 1) stored_.notify_one();
      return;
    }
    outcome = OutcomeLocked(number);
  }
  done(outcome);
}

void Journal::EndWaits() {
  std::unique_lock lock(mutex_);
  while (true) {
    const auto now = std::chrono::steady_clock::now();
    const auto is_waiting = [&](const Waiter& waiter) {
      return waiter.number > last_stored_ && waiter.until > now && !ended_ && taken_over_.ok();
    };
    const auto over = std::stable_partition(waiters_.begin(), waiters_.end(), is_waiting);
    if (over == waiters_.end()) {
      if (ended_) return;
      if (waiters_.empty()) {
        stored_.wait(lock);
      } else {
        stored_.wait_until(lock, waiters_.front().until);
      }
      continue;
    }
    const std::vector<Waiter> ends(std::make_move_iterator(over), std::make_move_iterator(waiters_.end()));
    waiters_.erase(over, waiters_.end());
    std::vector<Status> outcomes;
    for (const Waiter& waiter : ends) outcomes.push_back(OutcomeLocked(waiter.number));
    lock.unlock();
    for (size_t i = 0; i < ends.size(); ++i) ends[i].done(outcomes[i]);
    lock.lock();
  }
}

Status Journal::trouble() const {
  std::lock_guard lock(mutex_);
  return trouble_;
}

JournalStats Journal::stats() const {
  std::lock_guard lock(mutex_);
  JournalStats stats = stats_;
  stats.waiting = last_ - last_stored_;
  return stats;
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
    stored_.notify_one();
  }
}

void Journal::CountLocked(size_t records, Durability durability, double seconds, const Status& status) {
  if (!status.ok()) {
    ++stats_.failed;
    return;
  }
  ++stats_.batches;
  stats_.records += static_cast<int64_t>(records);
  stats_.syncs += durability == Durability::kMachine ? 1 : 0;
  stats_.seconds.Add(seconds);
  stats_.batch_records.Add(static_cast<double>(records));
}

bool Journal::Store(const std::vector<Entry>& batch) {
  std::vector<std::string_view> records;
  Durability durability = Durability::kProcess;
  for (const Entry& entry : batch) {
    records.push_back(entry.record);
    durability = std::max(durability, entry.durability);
  }
  for (auto pause = kFirstPause;; pause = std::min(2 * pause, kLongestPause)) {
    const auto start = std::chrono::steady_clock::now();
    const Status status = store_->Append(records, durability);
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    std::unique_lock lock(mutex_);
    CountLocked(records.size(), durability, seconds, status);
    if (IsTakenOver(status)) {
      lock.unlock();
      if (options_.on_taken_over) options_.on_taken_over(status);
      lock.lock();
      trouble_ = status;
      taken_over_ = absl::UnavailableError("unavailable: another coordinator has taken over: call it instead");
      stored_.notify_one();
      return false;
    }
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
