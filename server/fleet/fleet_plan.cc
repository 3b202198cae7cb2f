#include "server/fleet/fleet_plan.h"

#include <algorithm>
#include <set>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"

namespace tessera {
namespace {

constexpr double kLongPending_s = 300;

int Count(size_t size) { return static_cast<int>(size); }

const ClassBackoff& BackoffOf(const FleetBackoff& backoff, const std::string& name) {
  static const ClassBackoff kNone;
  const auto it = backoff.classes.find(name);
  return it == backoff.classes.end() ? kNone : it->second;
}

// Workers that are no pilots of this fleet, by the largest class that they can stand for.
void CountOthers(const FleetFile& fleet, const std::vector<Pilot>& pilots, const std::vector<FleetWorker>& workers,
                 std::vector<ClassPlan>* classes) {
  std::set<std::string> ours;
  for (const Pilot& pilot : pilots) ours.insert(pilot.allocation);
  for (const FleetWorker& worker : workers) {
    if (worker.suspended || (!worker.allocation.empty() && ours.contains(worker.allocation))) continue;
    for (size_t c = classes->size(); c-- > 0;) {
      if (worker.memory_bytes < WorkerMemory_mib(fleet.classes[c]) << 20) continue;
      ++(*classes)[c].others;
      break;
    }
  }
}

std::string StopText(const ClassBackoff& state) {
  const auto retry = absl::FromUnixSeconds(static_cast<int64_t>(state.retry_s));
  return absl::StrCat("stopped until ", absl::FormatTime("%H:%M:%S", retry, absl::LocalTimeZone()),
                      ", then one is tried: ", state.reason);
}

// Why the oldest pending pilot of a class waits; empty if none waits for long.
std::string LongPending(const std::vector<const Pilot*>& pending, double now_s) {
  const Pilot* oldest = nullptr;
  for (const Pilot* pilot : pending) {
    if (pilot->submitted_s <= 0 || now_s - pilot->submitted_s < kLongPending_s) continue;
    if (oldest == nullptr || pilot->submitted_s < oldest->submitted_s) oldest = pilot;
  }
  if (oldest == nullptr) return "";
  return absl::StrCat("pending for more than 5 minutes: ",
                      oldest->reason.empty() ? "the scheduler gives no reason" : oldest->reason);
}

std::string UnfitText(const FleetDemand& demand) {
  const FleetDemand::Unfit& first = demand.unfit.front();
  return absl::StrCat(
      demand.unfit_count, " tasks fit the memory or time limit of no class, so no pilots are submitted ",
      "for them; one is ", first.task, " (", first.title, "): ", (first.memory_bytes + (1 << 20) - 1) >> 20, " MiB, ",
      static_cast<int64_t>(first.core_s), " core-seconds. Add a larger class");
}

}  // namespace

FleetPlan PlanFleet(const FleetFile& fleet, const FleetDemand& demand, const std::vector<Pilot>& pilots,
                    const std::vector<FleetWorker>& workers, const FleetBackoff& backoff, double now_s) {
  FleetPlan plan;
  const size_t count = fleet.classes.size();
  plan.classes.resize(count);
  std::vector<std::vector<const Pilot*>> pending(count);
  for (const Pilot& pilot : pilots) {
    const auto c = static_cast<size_t>(pilot.pilot_class);
    if (pilot.state == PilotState::kPending) pending[c].push_back(&pilot);
    if (pilot.state == PilotState::kRunning) ++plan.classes[c].running;
  }
  for (auto& of_class : pending) {
    std::stable_sort(of_class.begin(), of_class.end(),
                     [](const Pilot* a, const Pilot* b) { return a->submitted_s < b->submitted_s; });
  }
  CountOthers(fleet, pilots, workers, &plan.classes);

  // What counts for a class, itself and the larger ones: pilots, other workers, and what the larger ones lack, because
  // smaller pilots could not do its work.
  std::vector<int> covered(count);  // without pilots that are only planned
  int cover = 0, present = 0;
  for (size_t c = count; c-- > 0;) {
    const PilotClass& limits = fleet.classes[c];
    const ClassBackoff& state = BackoffOf(backoff, limits.name);
    ClassPlan& own = plan.classes[c];
    const bool stopped = state.StoppedAt(now_s);
    own.pending = Count(pending[c].size()) + state.submitted;
    const int pilots_now = own.running + own.pending;
    const int usable = own.running + own.others + (stopped ? 0 : own.pending);
    cover += usable;
    present = std::max(present + usable, demand.wanted[c]);
    covered[c] = present;
    const int missing = std::max(demand.wanted[c] - cover, limits.least - pilots_now);
    int room = std::min(limits.most - pilots_now, limits.most_pending - own.pending);
    if (state.stops > 0) room = std::min(room, 1 - pilots_now);
    if (!stopped && backoff.lists_before_submit == 0) own.submit = std::clamp(missing, 0, std::max(room, 0));
    if (stopped) {
      own.why = StopText(state);
    } else if (missing > 0 && pilots_now >= limits.most) {
      own.why = absl::StrCat("limited to ", limits.most, " pilots by 'most'");
    } else if (missing > 0 && own.pending >= limits.most_pending) {
      own.why = absl::StrCat("limited to ", limits.most_pending, " pending pilots by 'most_pending'");
    } else if (missing > 0 && state.stops > 0) {
      own.why = absl::StrCat("one pilot is tried after a stop: ", state.reason);
    } else if (missing > 0 && backoff.lists_before_submit > 0) {
      own.why = "the answer of the last submit command is not known";
    }
    const std::string long_pending = LongPending(pending[c], now_s);
    if (own.why.empty()) own.why = long_pending;
    if (stopped) plan.messages.push_back({limits.name, absl::StrCat("class ", limits.name, " is ", own.why)});
    if (!long_pending.empty()) {
      plan.messages.push_back(
          {limits.name + " pending", absl::StrCat("pilots of class ", limits.name, " are ", long_pending)});
    }
    cover = std::max(cover + own.submit, demand.wanted[c]);
  }

  for (size_t c = count; c-- > 0;) {
    ClassPlan& own = plan.classes[c];
    const bool stopped = BackoffOf(backoff, fleet.classes[c].name).StoppedAt(now_s);
    int surplus = Count(pending[c].size());
    if (!stopped) {
      surplus = std::min(surplus, own.running + own.pending - fleet.classes[c].least);
      for (size_t k = 0; k <= c; ++k) surplus = std::min(surplus, covered[k] - demand.wanted[k]);
    }
    for (int i = 0; i < surplus; ++i) own.cancel.push_back(pending[c][pending[c].size() - 1 - i]->job);
    if (stopped || surplus <= 0) continue;
    for (size_t k = 0; k <= c; ++k) covered[k] -= surplus;
  }
  if (demand.unfit_count > 0 && !demand.unfit.empty()) plan.messages.push_back({"unfit", UnfitText(demand)});
  return plan;
}

}  // namespace tessera
