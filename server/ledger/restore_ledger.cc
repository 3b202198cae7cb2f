#include "server/ledger/restore_ledger.h"

#include <tbb/concurrent_queue.h>

#include <set>
#include <thread>
#include <utility>
#include <vector>

#include "server/ledger/check_record.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

constexpr size_t kBatchRecords = 256, kBatchBytes = 256 << 10;  // a batch ends at either
constexpr int kBatchesAhead = 8;

struct ReadRecord {
  int64_t number = 0;
  Status status;
  v1::Record record;
};

// Calls `visit` in this thread for each record, in order; a second thread reads ahead. `status`: why it is missing.
Status ReadRecords(RecordStore& store,
                   const std::function<void(int64_t number, Status status, const v1::Record& record)>& visit) {
  tbb::concurrent_bounded_queue<std::vector<ReadRecord>> batches;  // an empty batch ends the queue
  batches.set_capacity(kBatchesAhead);
  Status status;
  std::thread reader([&] {
    std::vector<ReadRecord> batch;
    size_t bytes = 0;
    status = store.Replay([&](const StoredRecord& stored) {
      ReadRecord& read = batch.emplace_back();
      read.number = stored.number;
      read.status = stored.content.status();
      if (read.status.ok()) {
        bytes += stored.content->size();
        if (!read.record.ParseFromString(*stored.content)) {
          read.status = absl::DataLossError("cannot parse the record");
          read.record.Clear();
        }
      }
      if (batch.size() < kBatchRecords && bytes < kBatchBytes) return;
      batches.push(std::exchange(batch, {}));
      bytes = 0;
    });
    if (!batch.empty()) batches.push(std::move(batch));
    batches.push({});
  });
  for (std::vector<ReadRecord> batch; batches.pop(batch), !batch.empty();) {
    for (ReadRecord& read : batch) visit(read.number, std::move(read.status), read.record);
  }
  reader.join();
  return status;
}

}  // namespace

StatusOr<int64_t> RestoreLedger(
    RecordStore& store, Ledger& ledger,
    const std::function<void(int64_t number, const Status& reason, const v1::Record& record)>& on_unusable) {
  TESSERA_ASSIGN_OR_RETURN(const std::set<int> deleted, store.DeletedJobs());
  ledger.ExpectDeleted(deleted);
  int64_t applied = 0;
  TESSERA_RETURN_IF_ERROR(ReadRecords(store, [&](int64_t number, Status status, const v1::Record& record) {
    if (status.ok()) status = CheckRecord(ledger, record);
    if (!status.ok()) return on_unusable(number, status, record);
    ledger.Apply(record);
    ++applied;
  }));
  for (const int job : deleted) {
    if (job < static_cast<int>(ledger.jobs().size())) continue;
    v1::Record record;
    record.set_time_us(ledger.ready().now_us());
    record.mutable_job_deleted()->set_job(JobName(job));
    if (CheckRecord(ledger, record).ok()) ledger.Apply(record);
  }
  return applied;
}

}  // namespace tessera
