#include "server/ledger/blob_references.h"

#include <algorithm>
#include <charconv>

#include "common/exporting/export_parameters.h"
#include "common/job/task_parameters.h"
#include "server/ledger/ledger.h"
#include "server/ledger/record_owner.h"
#include "tessera/v1/records.pb.h"

namespace tessera {

uint64_t BlobReferences::IdOf(const std::string& sha256) {
  uint64_t id = 0;
  std::from_chars(sha256.data(), sha256.data() + std::min<size_t>(16, sha256.size()), id, 16);
  return id;
}

void BlobReferences::AddJob(const Job& job) {
  for (const NamedDigest& artifact : job.artifacts) needed_.insert(IdOf(artifact.digest.sha256));
  for (const NamedDigest& file : job.scene_files) {
    if (file.name == kClassifierFile) needed_.insert(IdOf(file.digest.sha256));
  }
}

void BlobReferences::AddOutputs(const JobHeader& job, bool runs, absl::Span<const StoredFile> outputs) {
  for (const StoredFile& output : outputs) {
    const uint64_t id = IdOf(output.sha256.Hex());
    const bool handed_on = output.name == kTileFile || output.name == kViewsFile || output.name == kSumsFile ||
                           output.name == kMovedFile || output.name.str().ends_with(kLikelihoodsEnding) || IsPassedOn(output.name.str());
    if (runs || !handed_on) {
      needed_.insert(id);
    } else {
      int64_t& since_us = spare_[id];
      since_us = std::max(since_us, job.end_us);
    }
  }
}

int64_t BlobReferences::SpareSince(uint64_t id) const {
  const auto it = spare_.find(id);
  return it == spare_.end() || Needs(id) ? -1 : it->second;
}

bool HasTasksToRun(const Ledger& ledger, int job) {
  if (!HasEnded(ledger.jobs()[job].header.state)) return true;
  const auto remake = ledger.remakes_of_ended().lower_bound({job, -1});
  return remake != ledger.remakes_of_ended().end() && remake->job == job;
}

void NewReferences::Note(const v1::Record& record, const Ledger& ledger) {
  if (!noted_) return;
  const auto note = [&](const auto& files) {
    for (const auto& file : files) noted_->blobs.insert(BlobReferences::IdOf(file.digest().sha256()));
  };
  note(record.task_succeeded().outputs());
  note(record.job_ended().artifacts());
  for (const auto& task : record.tasks_planned().tasks()) note(task.given());
  for (const auto& file : record.job_accepted().scene_files()) {
    if (file.path() == kClassifierFile) noted_->blobs.insert(BlobReferences::IdOf(file.digest().sha256()));
  }
  // These records make an ended job run, and a running job needs all its outputs.
  const int job = record.has_job_retried() || record.has_result_lost() ? JobOf(record) : -1;
  if (job < 0 || !noted_->jobs.insert(job).second) return;
  for (const JobTask& task : ledger.jobs()[job].tasks) {
    for (const StoredFile& file : task.outputs) noted_->blobs.insert(BlobReferences::IdOf(file.sha256.Hex()));
  }
}

}  // namespace tessera
