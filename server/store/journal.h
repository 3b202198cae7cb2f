// Stores records in the background, as many with one sync as have come meanwhile.
#ifndef TESSERA_SERVER_STORE_JOURNAL_H_
#define TESSERA_SERVER_STORE_JOURNAL_H_

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "common/base/status.h"
#include "server/store/record_store.h"

namespace tessera {

// Whoever adds a record goes on at once, and waits for it before telling anybody. What cannot be stored (a full disk, a
// database that a backup holds) is tried again until it can: the order is kept, and nothing is left out. Thread-safe.
class Journal {
 public:
  struct Options {
    double wait_s = 20;  // longest that Wait waits
    // Told of every record once it is stored, in order. May be empty.
    std::function<void(const std::string& record)> on_stored = {};
    // Told when storing begins to fail, and why; OK when it works again. May be empty.
    std::function<void(const Status& trouble)> on_trouble = {};
  };

  // `store` must outlive the journal.
  Journal(RecordStore* store, Options options);
  // Stores what was added, unless that fails.
  ~Journal();

  // Gives the record's number, counted from 1. Records are stored in the order of the calls.
  int64_t Add(std::string record, Durability durability);
  // The last that was added; 0 if none was.
  int64_t last() const;
  // The last that is stored.
  int64_t stored() const;
  // Waits until all records up to `number` are stored. UNAVAILABLE, with what stands in the way, if that takes too
  // long.
  Status Wait(int64_t number) const;
  // Why nothing can be stored now; OK if nothing is known.
  Status trouble() const;

 private:
  struct Entry {
    std::string record;
    Durability durability;
  };
  void Run();
  bool Store(const std::vector<Entry>& batch);  // with retries; false if it was given up

  RecordStore* const store_;
  const Options options_;
  mutable std::mutex mutex_;
  std::condition_variable added_;
  mutable std::condition_variable stored_;
  std::vector<Entry> waiting_;
  int64_t last_ = 0;
  int64_t last_stored_ = 0;
  Status trouble_;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace tessera

#endif  // TESSERA_SERVER_STORE_JOURNAL_H_
