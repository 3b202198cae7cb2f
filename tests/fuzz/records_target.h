// Replays stored records, one per frame, into a ledger.
#pragma once

#include <string>

#include "common/base/version.h"
#include "server/jobs/job_report.h"
#include "server/ledger/ledger.h"
#include "server/ledger/record_owner.h"
#include "tessera/v1/records.pb.h"
#include "tests/fuzz/frames.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// What is told of a job, and what is asked of it before it is planned on, deleted or begun anew.
inline std::string DescribeJob(const Ledger& ledger, int index) {
  const Job& job = ledger.jobs()[index];
  std::string text = job.header.name + (ledger.WasDeleted(index) ? " deleted" : "");
  if (ledger.WasDeleted(index)) return text;
  text += ledger.MayDelete(index).ToString() + ledger.CheckVersion(index, "").ToString();
  text += ledger.BaseOf(job.header.name).status().ToString();
  JobReport report(job.header, job.header.state, job.header.error, {}, job.header.end_us);
  for (const JobTask& task : job.tasks) report.Count(task);
  text += report.Head();
  for (const JobTask& task : job.tasks) {
    text += report.Line(task);
    text += ledger.InputsOf(job, task.plan).status().ToString();
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
    const Status status = ledger.Check(record);
    Require(status.code() == again.Check(record).code(), "equal ledgers take equal records");
    if (!status.ok()) {
      taken = false;
      continue;
    }
    ledger.Apply(record);
    again.Apply(record);
    // Who is there to run tasks looks in between.
    if (frame.kind == 1) again.TakeNewlyReady();
    if (frame.kind == 2) ledger.FreeDeleted(1);
    if (frame.kind == 3) ledger.PromoteRetries(record.time_us());
  }
  ledger.EndReplay();
  again.EndReplay();
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
