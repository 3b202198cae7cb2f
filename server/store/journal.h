// Stores records in the background, as many with one sync as have come meanwhile.
#ifndef TESSERA_SERVER_STORE_JOURNAL_H_
#define TESSERA_SERVER_STORE_JOURNAL_H_

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "common/base/histogram.h"
#include "common/base/status.h"
#include "server/store/record_store.h"

namespace tessera {

// What a journal has done since it was made.
struct JournalStats {
  int64_t batches = 0;  // stored
  int64_t records = 0;
  int64_t syncs = 0;    // of the batches, those that were to survive a failure of the machine
  int64_t failed = 0;   // tries to store a batch
  int64_t waiting = 0;  // records that are not stored yet
  Histogram seconds{{0.0003, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1, 3, 10}};  // a batch, once it could be stored
  Histogram batch_records{{1, 3, 10, 30, 100, 300, 1000, 4096}};
};

// Whoever adds a record goes on at once, and waits for it before telling anybody: in its own thread or, for thousands
// at once, without one. What cannot be stored (a full disk, a database that a backup holds) is tried again until it
// can: the order is kept, and nothing is left out. Thread-safe.
class Journal {
 public:
  // OK once all that was waited for is stored. UNAVAILABLE, with what stands in the way, if that takes too long.
  using Done = std::function<void(Status stored)>;

  struct Options {
    double wait_s = 20;  // longest wait
    // Told of every record once it is stored, in order. May be empty.
    std::function<void(const std::string& record)> on_stored = {};
    // Told when storing begins to fail, and why; OK when it works again. May be empty.
    std::function<void(const Status& trouble)> on_trouble = {};
  };

  // `store` must outlive the journal.
  Journal(RecordStore* store, Options options);
  // Stores what was added, unless that fails, and ends all waits.
  ~Journal();

  // Gives the record's number, counted from 1. Records are stored in the order of the calls.
  int64_t Add(std::string record, Durability durability);
  // The last that was added; 0 if none was.
  int64_t last() const;
  // The last that is stored.
  int64_t stored() const;
  // Waits until all records up to `number` are stored, or too long.
  Status Wait(int64_t number) const;
  // Calls `done` once, when that wait would be over: at once if all that was added is stored, else from a thread of the
  // journal's, where it must be quick and not wait for the journal. It is called without a lock of the journal's.
  void WhenStored(Done done) const;
  // Why nothing can be stored now; OK if nothing is known.
  Status trouble() const;
  JournalStats stats() const;

 private:
  struct Entry {
    std::string record;
    Durability durability;
  };
  struct Waiter {
    int64_t number;
    std::chrono::steady_clock::time_point until;
    Done done;
  };
  void Run();
  bool Store(const std::vector<Entry>& batch);  // with retries; false if it was given up
  void WhenStored(int64_t number, Done done) const;
  void CountLocked(size_t records, Durability durability, double seconds, const Status& status);
  std::string WhyLateLocked() const;
  void EndWaits();

  RecordStore* const store_;
  const Options options_;
  mutable std::mutex mutex_;
  std::condition_variable added_;
  mutable std::condition_variable stored_;  // or there is somebody who waits for it
  std::vector<Entry> waiting_;
  mutable std::deque<Waiter> waiters_;  // all wait equally long: in the order of their ends
  int64_t last_ = 0;
  int64_t last_stored_ = 0;
  Status trouble_;
  JournalStats stats_;
  bool stop_ = false;
  bool ended_ = false;  // nothing more will be stored
  std::thread thread_;
  std::thread waits_thread_;  // so that the next batch is stored while those who waited for the last one are told
};

}  // namespace tessera

#endif  // TESSERA_SERVER_STORE_JOURNAL_H_
