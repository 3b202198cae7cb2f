#include "server/fleet/fleet_status.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "common/base/printable.h"
#include "server/client/job_text.h"

namespace tessera {
namespace {

using Json = nlohmann::json;
using Row = std::vector<std::string>;

struct PilotRow {
  const Pilot* pilot;
  const FleetWorker* worker;  // null: not registered
  double seconds;             // pending or running; below 0: not known
};

// Pilots that have not ended, with their workers.
std::vector<PilotRow> PilotRows(const FleetView& view, double now_s) {
  std::map<std::string, const FleetWorker*> workers;
  for (const FleetWorker& worker : view.coordinator.workers) workers[worker.allocation] = &worker;
  std::vector<PilotRow> rows;
  for (const Pilot& pilot : view.pilots) {
    if (pilot.state == PilotState::kEnded) continue;
    const auto worker = pilot.allocation.empty() ? workers.end() : workers.find(pilot.allocation);
    const double since_s = pilot.state == PilotState::kPending ? pilot.submitted_s : pilot.started_s;
    rows.push_back({&pilot, worker == workers.end() ? nullptr : worker->second,
                    since_s > 0 ? std::max(0.0, now_s - since_s) : -1});
  }
  return rows;
}

std::string StateText(const Pilot& pilot) { return pilot.state == PilotState::kPending ? "pending" : "running"; }

std::string TitleOf(const std::map<std::string, std::string>& titles, const std::string& task) {
  const auto title = titles.find(task);
  return title == titles.end() || title->second.empty() ? task : title->second;
}

// What a pilot does.
std::string WorkText(const PilotRow& row, const std::map<std::string, std::string>& titles) {
  if (row.pilot->state == PilotState::kPending) return row.pilot->reason;
  if (row.worker == nullptr) return "its worker has not registered";
  if (row.worker->tasks.empty()) return row.worker->suspended ? "suspended" : "waits for a task";
  return absl::StrJoin(row.worker->tasks, ", ",
                       [&](std::string* out, const std::string& task) { absl::StrAppend(out, TitleOf(titles, task)); });
}

std::string OneLine(const std::string& text) {
  std::string line = text;
  std::replace(line.begin(), line.end(), '\n', ' ');
  return Printable(line);
}

}  // namespace

std::string FleetStatusText(const FleetFile& fleet, const FleetView& view,
                            const std::map<std::string, std::string>& titles, double now_s) {
  std::vector<Row> classes = {{"CLASS", "MEMORY", "WANTED", "RUNNING", "PENDING", "OTHERS", "WHY"}};
  for (size_t c = fleet.classes.size(); c-- > 0;) {
    const ClassPlan& plan = view.plan.classes[c];
    classes.push_back({fleet.classes[c].name, absl::StrCat(fleet.classes[c].memory_mib, " MiB"),
                       absl::StrCat(view.coordinator.demand.wanted[c]), absl::StrCat(plan.running),
                       absl::StrCat(plan.pending), absl::StrCat(plan.others),
                       plan.why.empty() ? "-" : OneLine(plan.why)});
  }
  std::vector<Row> pilots = {{"PILOT", "CLASS", "STATE", "FOR", "WORKER", "DOES"}};
  for (const PilotRow& row : PilotRows(view, now_s)) {
    pilots.push_back({Printable(row.pilot->job), fleet.classes[static_cast<size_t>(row.pilot->pilot_class)].name,
                      StateText(*row.pilot), row.seconds < 0 ? "-" : FormatDuration(row.seconds),
                      row.worker == nullptr ? "-" : Printable(row.worker->name), OneLine(WorkText(row, titles))});
  }
  std::string text = ColumnsText(classes);
  if (pilots.size() > 1) absl::StrAppend(&text, "\n", ColumnsText(pilots));
  for (const FleetMessage& message : view.plan.messages)
    absl::StrAppend(&text, "\n", PrintableLines(message.text), "\n");
  return text;
}

std::string FleetStatusJson(const FleetFile& fleet, const FleetView& view,
                            const std::map<std::string, std::string>& titles, double now_s) {
  Json classes = Json::array(), pilots = Json::array(), messages = Json::array();
  for (size_t c = 0; c < fleet.classes.size(); ++c) {
    const ClassPlan& plan = view.plan.classes[c];
    classes.push_back({{"name", fleet.classes[c].name},
                       {"memory_bytes", fleet.classes[c].memory_mib << 20},
                       {"wanted", view.coordinator.demand.wanted[c]},
                       {"running", plan.running},
                       {"pending", plan.pending},
                       {"others", plan.others},
                       {"why", plan.why}});
  }
  for (const PilotRow& row : PilotRows(view, now_s)) {
    Json tasks = Json::array();
    for (const std::string& task : row.worker == nullptr ? std::vector<std::string>() : row.worker->tasks) {
      tasks.push_back({{"task", task}, {"title", TitleOf(titles, task)}});
    }
    pilots.push_back({{"job", row.pilot->job},
                      {"class", fleet.classes[static_cast<size_t>(row.pilot->pilot_class)].name},
                      {"state", StateText(*row.pilot)},
                      {"seconds", row.seconds},
                      {"reason", row.pilot->reason},
                      {"worker", row.worker == nullptr ? "" : row.worker->name},
                      {"tasks", tasks}});
  }
  for (const FleetMessage& message : view.plan.messages) messages.push_back(message.text);
  const Json json = {{"name", fleet.name}, {"classes", classes}, {"pilots", pilots}, {"messages", messages}};
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace tessera
