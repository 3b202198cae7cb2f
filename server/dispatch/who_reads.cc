// Whom a content concerns.
#include <algorithm>

#include "server/dispatch/dispatcher.h"

namespace tessera {
namespace {

bool IsAmong(const std::vector<NamedDigest>& files, const Digest& digest) {
  return std::any_of(files.begin(), files.end(), [&](const NamedDigest& file) { return file.digest == digest; });
}

bool MadeSurvey(const JobTask& task, const Digest& digest) {
  if (task.plan.kind != kIngestKind && task.plan.kind != kUpdateKind) return false;
  return std::any_of(task.outputs.begin(), task.outputs.end(),
                     [&](const NamedDigest& output) { return output.name == kSurveyFile && output.digest == digest; });
}

}  // namespace

std::vector<std::pair<std::string, int>> Dispatcher::LeasesOf(const std::string& worker) const {
  std::lock_guard lock(mutex_);
  std::vector<std::pair<std::string, int>> leases;
  const auto known = leases_.workers().find(worker);
  if (known == leases_.workers().end()) return leases;
  for (const TaskRef ref : known->second.tasks) {
    const LeaseState* const lease = leases_.Find(ref);
    if (lease != nullptr) leases.emplace_back(TaskName(ref), lease->attempt);
  }
  return leases;
}

std::set<std::string> Dispatcher::InputsOfLeases(const std::string& worker) const {
  std::lock_guard lock(mutex_);
  std::set<std::string> inputs;
  const auto known = leases_.workers().find(worker);
  if (known == leases_.workers().end()) return inputs;
  for (const TaskRef ref : known->second.tasks) {
    const auto read = ledger_.InputsOf(ledger_.jobs()[ref.job], ledger_.task(ref).plan);
    if (!read.ok()) continue;  // it cannot be read now
    for (const NamedDigest& input : *read) inputs.insert(input.digest.sha256);
  }
  return inputs;
}

bool Dispatcher::IsPublished(const Digest& digest) const {
  std::lock_guard lock(mutex_);
  return std::any_of(ledger_.jobs().rbegin(), ledger_.jobs().rend(), [&](const Job& job) {
    return IsAmong(job.header.artifacts, digest) ||
           std::any_of(job.tasks.begin(), job.tasks.end(),
                       [&](const JobTask& task) { return MadeSurvey(task, digest); });
  });
}

}  // namespace tessera
