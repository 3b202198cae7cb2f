#include "server/tiles/tile_status.h"

#include <algorithm>
#include <set>

#include "absl/strings/str_cat.h"
#include "common/base/printable.h"

namespace tessera {
namespace {

std::string CutReason(const std::string& text) { return std::string(Prefix(text, kMaxReasonBytes)); }

const QuarantinedTile* FindQuarantined(const Job& job, int tile) {
  const auto found = std::lower_bound(job.quarantined.begin(), job.quarantined.end(), tile,
                                      [](const QuarantinedTile& each, int number) { return each.tile < number; });
  return found != job.quarantined.end() && found->tile == tile ? &*found : nullptr;
}

TileProgress ProgressOf(TaskState next) {
  switch (next) {
    case TaskState::kWaiting:
      return TileProgress::kWaiting;
    case TaskState::kReady:
      return TileProgress::kReady;
    case TaskState::kLeased:
      return TileProgress::kRunning;
    case TaskState::kSucceeded:
      return TileProgress::kDone;
    case TaskState::kFailed:
      return TileProgress::kFailed;
    case TaskState::kCancelled:
      return TileProgress::kCancelled;
  }
  return TileProgress::kWaiting;
}

void AddErrors(const JobTask& task, std::vector<std::string>* reasons) {
  for (int number = task.attempt(); number > 0 && reasons->size() < kMaxTileReasons; --number) {
    const Attempt& attempt = task.attempts[number - 1];
    if (attempt.failure->error_class == ErrorClass::kNone && !attempt.lease_expired) continue;
    const std::string why = attempt.lease_expired ? "lease expired" : ErrorClassName(attempt.failure->error_class);
    reasons->push_back(CutReason(absl::StrCat("attempt ", number, " on ", attempt.worker.str(), " failed (", why,
                                              "): ", attempt.failure->message)));
  }
  // A task may fail without an attempt of its own: an input could not be recomputed.
  if (reasons->empty() && task.error->error_class != ErrorClass::kNone) {
    reasons->push_back(
        CutReason(absl::StrCat("failed (", ErrorClassName(task.error->error_class), "): ", task.error->message)));
  }
}

// The results that a waiting task lacks: tiles, and other tasks as a reason.
void AddMissing(const Job& job, const JobTask& task, TileStatus* status) {
  std::set<int> tiles;
  std::string others;
  for (const PlannedInput& input : task.plan.inputs) {
    const JobTask& producer = job.tasks[input.task.value()];
    if (producer.state == TaskState::kSucceeded) continue;
    if (producer.plan.tile >= 0 && producer.plan.tile != task.plan.tile) {
      tiles.insert(producer.plan.tile);
    } else if (producer.plan.tile < 0 && others.empty()) {
      others = absl::StrCat("waits for '", producer.plan.name, "'");
    }
  }
  for (const int tile : tiles) {
    if (status->waits_for.size() < kMaxWaitsFor) status->waits_for.push_back(tile);
  }
  if (!others.empty()) status->reasons.push_back(CutReason(others));
}

// The statistics of the task; if its result was reused, of the task that made it.
std::string StatsOf(const Ledger& ledger, const JobTask& task) {
  constexpr int kMostSteps = 8;
  const JobTask* made = &task;
  for (int i = 0; i < kMostSteps && made->reused; ++i) {
    const TaskRef older = made->older_with_key;  // may be of a deleted job if the result was forgotten
    if (older.job < 0 || ledger.jobs()[older.job].deleted) return "";
    if (older.task >= static_cast<int>(ledger.jobs()[older.job].tasks.size())) return "";
    made = &ledger.task(older);
  }
  return made->stats;
}

}  // namespace

std::map<int, TaskRef> RunningByTile(const Ledger& ledger, int job, const LeaseTable& leases) {
  std::map<int, TaskRef> running;
  for (const TaskRef ref : leases.OfJob(job)) {
    const int tile = ledger.task(ref).plan.tile;
    if (tile >= 0) running.emplace(tile, ref);
  }
  return running;
}

TileStatus StatusOfTile(const Ledger& ledger, int index, int tile, const LeaseTable& leases,
                        const std::map<int, TaskRef>& running, const std::string& job_waits_for) {
  const Job& job = ledger.jobs()[index];
  const TileTotals& totals = job.totals.tiles().at(tile);
  const QuarantinedTile* const quarantined = FindQuarantined(job, tile);
  TileStatus status;
  status.tile = tile;
  status.attempts = totals.attempts;
  status.failed_attempts = totals.failed_attempts;
  status.core_seconds = totals.core_seconds;
  status.predicted_core_seconds = totals.predicted_core_seconds;
  status.peak_bytes = totals.peak_bytes;
  status.predicted_peak_bytes = totals.predicted_peak_bytes;
  status.tasks_total = static_cast<int>(totals.tasks.size());
  status.tasks_done = status.tasks_total - totals.unfinished + (quarantined != nullptr ? 1 : 0);
  status.tasks_reused = totals.reused;

  const auto leased = running.find(tile);
  const size_t open = totals.FirstOpen(job.tasks);
  TaskRef shown = {index, open < totals.tasks.size() ? totals.tasks[open] : -1};
  if (leased != running.end()) shown = leased->second;
  if (quarantined != nullptr) shown.task = quarantined->task;
  double done = totals.done_core_seconds;
  status.state = TileProgress::kDone;
  if (shown.task >= 0) {
    const JobTask& task = ledger.task(shown);
    status.state = quarantined != nullptr ? TileProgress::kQuarantined : ProgressOf(task.state);
    status.task = TaskName(shown);
    status.title = task.plan.name;
    status.worker = task.worker();
    if (const LeaseState* const lease = leases.Find(shown)) {
      status.stage = lease->stage;
      done += lease->progress * task.plan.cost;
    }
    AddErrors(task, &status.reasons);
    if (status.state == TileProgress::kWaiting) AddMissing(job, task, &status);
    if (status.state == TileProgress::kReady && !job_waits_for.empty()) status.reasons.push_back(job_waits_for);
    status.reasons.resize(std::min(status.reasons.size(), kMaxTileReasons));
  } else if (!totals.tasks.empty()) {
    status.last_stats = StatsOf(ledger, job.tasks[totals.tasks.back()]);
  }
  if (status.state == TileProgress::kDone) {
    status.progress = 1;
  } else if (totals.predicted_core_seconds > 0) {
    status.progress = std::clamp(done / totals.predicted_core_seconds, 0.0, 1.0);
  }
  return status;
}

}  // namespace tessera
