#include "server/fleet/backoff.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "common/base/json_bounds.h"

namespace tessera {
namespace {

using Json = nlohmann::json;

constexpr double kIntervalsToShow = 3;  // within which a list shows pilots that were submitted
constexpr int kMaxDoublings = 2;

void CountFailure(const std::string& pilot_class, const std::string& reason, double now_s, FleetBackoff* backoff) {
  ClassBackoff& state = backoff->classes[pilot_class];
  if (state.StoppedAt(now_s)) return;
  state.reason = reason;
  if (++state.failures < kFailuresToStop && state.stops == 0) return;
  state.failures = 0;
  state.retry_s = now_s + kFirstStop_s * (1 << std::min(state.stops, kMaxDoublings));
  ++state.stops;
  // Pilots that were submitted before say nothing about the next one.
  for (auto& [job, pilot] : backoff->pilots) {
    if (pilot.pilot_class == pilot_class) pilot.judged = true;
  }
}

std::string WithLines(std::string reason, const std::string& lines) {
  if (!lines.empty()) absl::StrAppend(&reason, ":\n", lines);
  while (reason.ends_with('\n')) reason.pop_back();
  return reason;
}

}  // namespace

std::string BackoffText(const FleetBackoff& backoff) {
  Json classes = Json::object(), pilots = Json::object();
  for (const auto& [name, state] : backoff.classes) {
    classes[name] = {{"failures", state.failures}, {"stops", state.stops},         {"retry_s", state.retry_s},
                     {"reason", state.reason},     {"submitted", state.submitted}, {"submitted_s", state.submitted_s}};
  }
  for (const auto& [job, pilot] : backoff.pilots) {
    pilots[job] = {{"class", pilot.pilot_class},
                   {"output", pilot.output},
                   {"registered", pilot.registered},
                   {"judged", pilot.judged}};
  }
  const Json json = {{"file", backoff.file},
                     {"classes", classes},
                     {"pilots", pilots},
                     {"lists_before_submit", backoff.lists_before_submit}};
  return json.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

StatusOr<FleetBackoff> ParseBackoff(const std::string& text) {
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth("the back-off", text));
  FleetBackoff backoff;
  try {
    const Json json = Json::parse(text);
    backoff.file = json.at("file");
    for (const auto& [name, state] : json.at("classes").items()) {
      backoff.classes[name] = {state.at("failures"), state.at("stops"),     state.at("retry_s"),
                               state.at("reason"),   state.at("submitted"), state.at("submitted_s")};
    }
    for (const auto& [job, pilot] : json.at("pilots").items()) {
      backoff.pilots[job] = {pilot.at("class"), pilot.at("output"), pilot.at("registered"), pilot.at("judged")};
    }
    backoff.lists_before_submit = json.at("lists_before_submit");
  } catch (const Json::exception& error) {
    return absl::InvalidArgumentError(error.what());
  }
  return backoff;
}

void JudgePilots(const FleetFile& fleet, const std::vector<Pilot>& pilots, const std::set<std::string>& allocations,
                 double now_s, const std::function<std::string(const std::string& output)>& last_lines,
                 FleetBackoff* backoff) {
  if (backoff->lists_before_submit > 0) --backoff->lists_before_submit;
  std::map<std::string, KnownPilot> before;
  before.swap(backoff->pilots);
  std::set<std::string> with_new_pilots;
  for (const Pilot& pilot : pilots) {
    const std::string& name = fleet.classes[static_cast<size_t>(pilot.pilot_class)].name;
    const auto known = before.find(pilot.job);
    KnownPilot& now_known = backoff->pilots[pilot.job];
    if (known != before.end()) {
      now_known = std::move(known->second);
      before.erase(known);
    } else {
      with_new_pilots.insert(name);
    }
    now_known.pilot_class = name;
    now_known.output = pilot.output;
    if (!now_known.registered && !pilot.allocation.empty() && allocations.contains(pilot.allocation)) {
      now_known.registered = true;
      ClassBackoff& state = backoff->classes[name];
      state.failures = state.stops = 0;
    }
  }
  for (const PilotClass& pilot_class : fleet.classes) {
    ClassBackoff& state = backoff->classes[pilot_class.name];
    if (with_new_pilots.contains(pilot_class.name)) state.submitted = 0;
    if (state.submitted == 0 || now_s - state.submitted_s < kIntervalsToShow * fleet.interval_s) continue;
    state.submitted = 0;
    CountFailure(pilot_class.name, "pilots were submitted, but the list of jobs does not show them", now_s, backoff);
  }
  // Those that are no longer listed ended before those that are.
  std::set<std::string> cancelled;
  for (const Pilot& pilot : pilots) {
    if (pilot.state == PilotState::kEnded && pilot.end == PilotEnd::kTakenAway) cancelled.insert(pilot.job);
  }
  for (const auto& [job, known] : before) {
    // Slurm lists the elements of an array that were cancelled while they were pending as one job.
    if (known.judged || known.registered || cancelled.contains(job.substr(0, job.find('_')))) continue;
    CountFailure(known.pilot_class,
                 WithLines(absl::StrCat("pilot ", job, " is no longer listed, and its worker has not registered"),
                           last_lines(known.output)),
                 now_s, backoff);
  }
  std::vector<const Pilot*> ended;
  for (const Pilot& pilot : pilots) {
    if (pilot.state == PilotState::kEnded) ended.push_back(&pilot);
  }
  std::stable_sort(ended.begin(), ended.end(), [](const Pilot* a, const Pilot* b) { return a->ended_s < b->ended_s; });
  for (const Pilot* pilot : ended) {
    KnownPilot& known = backoff->pilots[pilot->job];
    if (known.judged) continue;
    known.judged = true;
    if (known.registered || pilot->end == PilotEnd::kTakenAway) continue;
    if (pilot->end == PilotEnd::kSucceeded && pilot->ended_s - pilot->started_s > fleet.interval_s) {
      ClassBackoff& state = backoff->classes[known.pilot_class];
      state.failures = state.stops = 0;
      continue;
    }
    CountFailure(
        known.pilot_class,
        WithLines(absl::StrCat("pilot ", pilot->job, " ended before its worker registered (", pilot->reason, ")"),
                  last_lines(pilot->output)),
        now_s, backoff);
  }
}

void CountSubmit(const FleetFile& fleet, int pilot_class, int count, double now_s, FleetBackoff* backoff) {
  ClassBackoff& state = backoff->classes[fleet.classes[static_cast<size_t>(pilot_class)].name];
  state.submitted = count;
  state.submitted_s = now_s;
}

void CountLostSubmit(const FleetFile& fleet, int pilot_class, const std::string& reason, double now_s,
                     FleetBackoff* backoff) {
  backoff->lists_before_submit = kListsAfterLostAnswer;
  CountFailure(fleet.classes[static_cast<size_t>(pilot_class)].name, reason, now_s, backoff);
}

}  // namespace tessera
