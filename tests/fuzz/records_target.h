// Replays stored records, one per frame, into a ledger.
#pragma once

#include <string>

#include "common/base/version.h"
#include "server/jobs/job_report.h"
#include "server/ledger/base_of.h"
#include "server/ledger/check_record.h"
#include "server/ledger/ledger.h"
#include "server/ledger/record_owner.h"
#include "server/ledger/task_inputs.h"
#include "tessera/v1/records.pb.h"
#include "tests/fuzz/frames.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// What is displayed of a job, and what is checked before it is planned, deleted or restarted.
inline std::string DescribeJob(const Ledger& ledger, int index) {
  const Job& job = ledger.jobs()[index];
  std::string text = job.header.name + (job.deleted ? " deleted" : "");
  if (job.deleted) return text;
  text += CheckMayDelete(ledger, index).ToString() + ledger.CheckVersion(index, "").ToString();
  text += BaseOf(ledger, job.header.name).status().ToString();
  JobReport report(job.header, job.header.state, job.header.error, {}, job.header.end_us);
  for (const JobTask& task : job.tasks) report.Count(task);
  text += report.Head();
  for (const JobTask& task : job.tasks) {
    text += report.Line(task);
    text += InputsOf(job, task.plan).status().ToString();
  }
  return text + JobReport::Tail();
}

// True if all records were taken.
inline bool RunRecordsTarget(const std::string& bytes) {
  Ledger ledger(kAlgorithmVersion), again(kAlgorithmVersion);
  bool taken = true;
  for (const InputFrame& frame : SplitFrames(bytes)) {
    OwnerOfRecord(frame.bytes);
    v1::Record record;
    if (!record.ParseFromString(frame.bytes)) {
      taken = false;
      continue;
    }
    const Status status = CheckRecord(ledger, record);
    Require(status.code() == CheckRecord(again, record).code(), "equal ledgers take equal records");
    if (!status.ok()) {
      taken = false;
      continue;
    }
    ledger.Apply(record);
    again.Apply(record);
    // The coordinator calls these between records.
    if (frame.kind == 1) again.TakeNewlyReady();
    if (frame.kind == 2) ledger.FreeDeleted(1);
    if (frame.kind == 3) ledger.ready().Promote(record.time_us());
  }
  Require(ledger.jobs().size() == again.jobs().size(), "equal records give equal ledgers");
  for (int i = 0; i < static_cast<int>(ledger.jobs().size()); ++i) {
    Require(DescribeJob(ledger, i) == DescribeJob(again, i), "equal records give equal ledgers");
  }
  for (const int job : ledger.active_jobs()) {
    Require(!HasEnded(ledger.jobs()[job].header.state), "jobs that have ended are not active");
  }
  return taken;
}

}  // namespace tessera
