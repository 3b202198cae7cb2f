// Which rows of a table of records Replay visits.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <string>

#include "server/store/record_store.h"

namespace tessera {

// Not thread-safe.
class RecordRows {
 public:
  // `removed`: first and last number of ranges that do not touch.
  RecordRows(std::set<int64_t> quarantined, std::map<int64_t, int64_t> removed, std::set<int> deleted_jobs,
             const std::function<void(const StoredRecord& record)>& visit);
  // Rows in ascending order of their numbers. Visits the record unless it is quarantined or of a deleted job, and
  // before it the missing ones.
  void Add(int64_t id, const std::string& content, int64_t xxh3, int job);

 private:
  const std::set<int64_t> quarantined_;
  const std::map<int64_t, int64_t> removed_;
  const std::set<int> deleted_jobs_;
  const std::function<void(const StoredRecord& record)>& visit_;
  std::map<int64_t, int64_t>::const_iterator next_removed_;
  int64_t expected_ = 1;
};

}  // namespace tessera
