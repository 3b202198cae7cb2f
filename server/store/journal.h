// Journal: stores records in a background thread. One sync stores all records that have arrived (group commit).
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "common/base/status.h"
#include "server/store/histogram.h"
#include "server/store/record_store.h"

namespace tessera {

// Counters of a journal since its construction.
struct JournalStats {
  int64_t batches = 0;  // stored
  int64_t records = 0;
  int64_t syncs = 0;                                                          // batches with Durability::kMachine
  int64_t failed = 0;                                                         // failed attempts to store a batch
  int64_t waiting = 0;                                                        // records that are not stored yet
  Histogram seconds{{0.0003, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1, 3, 10}};  // per stored batch
  Histogram batch_records{{1, 3, 10, 30, 100, 300, 1000, 4096}};
};

// Add returns at once. A caller waits until its record is stored before it acknowledges the change: with Wait, or with
// WhenStored, which blocks no thread. A failed write (full disk, database locked by a backup) is retried until it
// succeeds; order is kept and no record is skipped. If another coordinator has taken over (IsTakenOver), nothing more
// is stored, and every present and later wait ends with UNAVAILABLE. Thread-safe.
class Journal {
 public:
  // OK when the records are stored; UNAVAILABLE with the reason if that takes longer than wait_s.
  using Done = std::function<void(Status stored)>;

  struct Options {
    double wait_s = 20;  // longest wait
    // Called for every stored record, in order. May be empty.
    std::function<void(const std::string& record)> on_stored = {};
    // Called with the error when writes begin to fail, and with OK when they succeed again. May be empty.
    std::function<void(const Status& trouble)> on_trouble = {};
    // Called once if another coordinator has taken over, before any wait ends. May be empty.
    std::function<void(const Status& reason)> on_taken_over = {};
  };

  // `store` must outlive the journal.
  Journal(RecordStore* store, Options options);
  // Tries to store the remaining records and ends all waits.
  ~Journal();

  // Returns the record's number, counted from 1. Records are stored in the order of the calls.
  int64_t Add(std::string record, Durability durability);
  // Number of the last added record; 0 if there is none.
  int64_t last() const;
  // Number of the last stored record.
  int64_t stored() const;
  // Waits until all records up to `number` are stored, at most wait_s.
  Status Wait(int64_t number) const;
  // Calls `done` once, when all records added so far are stored or wait_s has passed: immediately if nothing is
  // waiting, else from a thread of the journal. `done` must be quick and must not wait for the journal. No lock is
  // held.
  void WhenStored(Done done) const;
  // Why writes fail now; OK if they do not. Stays if another coordinator has taken over.
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
  // Retries. False if stopped before success, or if another coordinator has taken over.
  bool Store(const std::vector<Entry>& batch);
  void WhenStored(int64_t number, Done done) const;
  void CountLocked(size_t records, Durability durability, double seconds, const Status& status);
  // What a caller is told whose records up to `number` are stored, or never will be, or not in time.
  Status OutcomeLocked(int64_t number) const;
  void EndWaits();

  RecordStore* const store_;
  const Options options_;
  mutable std::mutex mutex_;
  std::condition_variable added_;
  mutable std::condition_variable stored_;  // notified when records are stored or a waiter is added
  std::vector<Entry> waiting_;
  mutable std::deque<Waiter> waiters_;  // all have the same timeout, so deadlines are in order
  int64_t last_ = 0;
  int64_t last_stored_ = 0;
  Status trouble_;
  Status taken_over_;  // UNAVAILABLE once another coordinator has taken over
  JournalStats stats_;
  bool stop_ = false;
  bool ended_ = false;  // no further record will be stored
  std::thread thread_;
  std::thread waits_thread_;  // calls the waiters while thread_ stores the next batch
};

}  // namespace tessera
