// Whom a content concerns.
#include <algorithm>

#include "server/jobs/dispatcher.h"

namespace tessera {
namespace {

bool IsAmong(const std::vector<NamedDigest>& files, const Digest& digest) {
  return std::any_of(files.begin(), files.end(), [&](const NamedDigest& file) { return file.digest == digest; });
}

// Surveys are made before all cuts, and behind those there may be a million tasks.
bool MadeSurvey(const Job& job, const Digest& digest) {
  for (const JobTask& task : job.tasks) {
    const TaskPhase phase = KindOf(task.plan.kind.str()).phase;
    if (phase == TaskPhase::kCut) return false;
    if (phase != TaskPhase::kSurvey) continue;
    for (const StoredFile& output : task.outputs) {
      if (output.name == kSurveyFile && output.digest() == digest) return true;
    }
  }
  return false;
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
  return std::any_of(ledger_.jobs().rbegin(), ledger_.jobs().rend(),
                     [&](const Job& job) { return IsAmong(job.header.artifacts, digest) || MadeSurvey(job, digest); });
}

}  // namespace tessera
