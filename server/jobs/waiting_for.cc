#include "server/jobs/waiting_for.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <vector>

#include "common/job/end_margin.h"
#include "server/leases/worker_evidence.h"

namespace tessera {
namespace {

std::string Duration(int64_t us) {
  const auto seconds = std::llround(static_cast<double>(std::max<int64_t>(us, 0)) / 1e6);
  if (seconds < 120) return std::to_string(seconds) + " s";
  if (seconds < 7200) return std::to_string(seconds / 60) + " min";
  return std::to_string(seconds / 3600) + " h";
}

std::string Gib(int64_t bytes) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.1f GiB", static_cast<double>(bytes) / (1 << 30));
  return text;
}

std::string Quoted(const JobTask& task) { return "'" + task.plan.name + "'"; }

// The first line, at most kMost characters.
std::string Short(const std::string& message) {
  constexpr size_t kMost = 200;
  const std::string line = message.substr(0, message.find('\n'));
  return line.size() <= kMost ? line : line.substr(0, kMost) + "...";
}

// If the time of each worker with the task's memory ends too early.
std::string TooLittleTime(const JobTask& task, const LeaseTable& leases, const LargestWorker& largest, int64_t now_us) {
  const int64_t bytes = std::min(task.plan.peak_bytes, largest.memory_bytes);
  double longest_s = 0, needed_s = 0;
  for (const auto& [name, worker] : leases.workers()) {
    if (worker.info.memory_bytes != 0 && worker.info.memory_bytes < bytes) continue;
    if (HasTime(worker, task.plan.cost, worker.info.threads, now_us)) return "";
    const double left_s = TimeLeft_s(worker, now_us);
    if (left_s <= longest_s) continue;
    longest_s = left_s;
    needed_s = task.plan.cost / std::max(1, worker.info.threads);
  }
  return "no worker has the time for " + Quoted(task) + ", which takes about " + Duration(Micros(needed_s)) +
         " and must end " + Duration(Micros(kEndMargin_s)) + " before the worker's time limit: the longest has " +
         Duration(Micros(longest_s)) + " left, and gets it after " + Duration(Micros(kLongerWorkerWait_s)) +
         " without another task unless one with more time registers";
}

// Why a ready task is not leased; empty if it is about to be.
std::string WhyNotLeased(const Ledger& ledger, TaskRef ref, const LeaseTable& leases, int64_t now_us) {
  if (leases.workers().empty()) return "no worker is registered";
  const auto trusted = std::find_if(leases.workers().begin(), leases.workers().end(),
                                    [&](const auto& worker) { return !IsSuspended(worker.second, now_us); });
  if (trusted == leases.workers().end()) {
    const WorkerState& first = leases.workers().begin()->second;
    return (leases.workers().size() == 1 ? "the only worker is" : "all workers are") + std::string(" suspended: ") +
           Short(first.suspended_reason);
  }
  const JobTask& task = ledger.task(ref);
  const LargestWorker largest = leases.Largest();
  if (largest.memory_bytes > 0 && task.plan.peak_bytes > largest.memory_bytes) {
    std::string words = "no worker has " + Gib(task.plan.peak_bytes) + " for " + Quoted(task) + ": the largest has " +
                        Gib(largest.memory_bytes);
    const int64_t left_us = largest.since_us + Micros(kLargerWorkerWait_s) - now_us;
    if (left_us > 0) words += ", and gets it in " + Duration(left_us) + " unless a larger one registers";
    return words;
  }
  if (const std::string words = TooLittleTime(task, leases, largest, now_us); !words.empty()) return words;
  const std::optional<int> first = ledger.ready().FirstJob();
  if (first && *first != ref.job) {
    const JobHeader& before = ledger.jobs()[*first].header;
    const bool higher = before.priority > ledger.jobs()[ref.job].header.priority;
    return before.name + (higher ? ", of priority " + std::to_string(before.priority) : ", an older job") +
           ", goes first";
  }
  const bool any_idle = std::any_of(leases.workers().begin(), leases.workers().end(),
                                    [](const auto& worker) { return worker.second.tasks.empty(); });
  if (!any_idle) {
    return leases.workers().size() == 1 ? "the only worker is busy"
                                        : "all " + std::to_string(leases.workers().size()) + " workers are busy";
  }
  return "";
}

}  // namespace

std::string WaitingFor(const Ledger& ledger, int job, const LeaseTable& leases, const Status& storage_trouble,
                       const Room& room, int64_t now_us) {
  const JobHeader& header = ledger.jobs()[job].header;
  if (HasEnded(header.state)) return "";
  if (!storage_trouble.ok()) {
    return "journal write failed, leasing suspended: " + Short(std::string(storage_trouble.message()));
  }
  const std::vector<TaskRef> running = leases.OfJob(job);
  if (header.paused) {
    return running.empty() ? "paused" : "paused; " + std::to_string(running.size()) + " tasks are still running";
  }
  if (running.empty() && ledger.ready().IsHeld(job) && !room.folder.empty()) {
    return "not enough disk space for the " + Gib(BytesToStore(ledger.jobs()[job])) +
           " of its results: " + Gib(room.free_bytes) + " are free in " + room.folder +
           (room.promised_bytes > 0 ? ", of which running jobs need " + Gib(room.promised_bytes) : "") +
           "; it starts when there is enough";
  }
  if (const std::optional<TaskRef> ready = ledger.ready().FirstOfJob(job)) {
    return running.empty() ? WhyNotLeased(ledger, *ready, leases, now_us) : "";
  }
  if (!running.empty()) {
    const TaskRef longest = *std::min_element(running.begin(), running.end(), [&](TaskRef a, TaskRef b) {
      return leases.Find(a)->start_us < leases.Find(b)->start_us;
    });
    const LeaseState& lease = *leases.Find(longest);
    const auto worker = leases.workers().find(lease.worker);
    const std::string host = worker == leases.workers().end() ? "" : worker->second.info.host;
    return "waiting for " + Quoted(ledger.task(longest)) + (host.empty() ? "" : ", on " + host) + " for " +
           Duration(now_us - lease.start_us) +
           (running.size() > 1 ? ", and " + std::to_string(running.size() - 1) + " others" : "");
  }
  if (const auto delayed = ledger.ready().NextOfDelayed(job, now_us)) {
    const JobTask& task = ledger.task(delayed->second);
    return Quoted(task) + " is retried in " + Duration(delayed->first - now_us) +
           ", after: " + Short(task.error->message);
  }
  return "the coordinator plans its tasks";
}

}  // namespace tessera
