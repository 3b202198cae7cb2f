#include "server/fleet/job_list.h"

#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "common/base/json_bounds.h"

namespace tessera {
namespace {

using Json = nlohmann::json;

constexpr int kMaxElements = 100'000;  // of an array

std::map<std::string, int> ClassesByJobName(const FleetFile& fleet) {
  std::map<std::string, int> classes;
  for (size_t i = 0; i < fleet.classes.size(); ++i) classes[JobName(fleet, fleet.classes[i])] = static_cast<int>(i);
  return classes;
}

Status NotAList(const std::string& why) { return absl::InvalidArgumentError("the list of jobs is invalid: " + why); }

// The object {"jobs": [...]} with only the jobs of these names: a cluster may have many others.
StatusOr<Json> ParseJobs(const std::string& text, const std::map<std::string, int>& names) {
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth("the list of jobs", text));
  constexpr int kJobDepth = 2;
  std::string key;
  const auto keep = [&](int depth, Json::parse_event_t event, Json& parsed) {
    if (depth == 1 && event == Json::parse_event_t::key) key = parsed.get<std::string>();
    if (depth != kJobDepth || event != Json::parse_event_t::object_end || key != "jobs") return true;
    const auto name = parsed.find("name");
    return name == parsed.end() || !name->is_string() || names.contains(name->get<std::string>());
  };
  const Json list = Json::parse(text, keep, /*allow_exceptions=*/false);
  if (!list.is_object()) return NotAList("it is not a complete JSON object");
  const auto jobs = list.find("jobs");
  if (jobs == list.end() || !jobs->is_array()) return NotAList("it has no array 'jobs'");
  return list;
}

const Json& Field(const Json& object, const std::string& name) {
  static const Json kNull;
  const auto it = object.is_object() ? object.find(name) : object.end();
  return it == object.end() ? kNull : *it;
}

std::string Text(const Json& object, const std::string& name) {
  const Json& value = Field(object, name);
  return value.is_string() ? value.get<std::string>() : "";
}

// A number, also as {"set": true, "infinite": false, "number": 5}; `otherwise` if it is not set.
double Number(const Json& object, const std::string& name, double otherwise) {
  const Json& value = Field(object, name);
  if (value.is_number()) return value.get<double>();
  const Json& number = Field(value, "number");
  return number.is_number() && Field(value, "set") != false ? number.get<double>() : otherwise;
}

// The words of a text or of a list of texts.
std::set<std::string> StateWords(const Json& value) {
  if (value.is_string()) return absl::StrSplit(value.get<std::string>(), '+');
  std::set<std::string> words;
  if (!value.is_array()) return words;
  for (const Json& word : value) {
    if (word.is_string()) words.insert(word.get<std::string>());
  }
  return words;
}

// Unknown states count as running: then no other pilot is submitted for one that may exist.
void SetSlurmState(const std::set<std::string>& words, Pilot* pilot) {
  static const std::map<std::string, PilotEnd> kEnds = {
      {"COMPLETED", PilotEnd::kSucceeded},  {"FAILED", PilotEnd::kFailed},       {"TIMEOUT", PilotEnd::kFailed},
      {"OUT_OF_MEMORY", PilotEnd::kFailed}, {"CANCELLED", PilotEnd::kTakenAway}, {"PREEMPTED", PilotEnd::kTakenAway},
      {"NODE_FAIL", PilotEnd::kTakenAway},  {"BOOT_FAIL", PilotEnd::kTakenAway}, {"DEADLINE", PilotEnd::kTakenAway},
      {"REVOKED", PilotEnd::kTakenAway}};
  pilot->state = PilotState::kRunning;
  if (words.contains("PENDING") || words.contains("REQUEUED") || words.contains("REQUEUE_HOLD") ||
      words.contains("SPECIAL_EXIT")) {
    pilot->state = PilotState::kPending;
  } else if (!words.contains("COMPLETING")) {
    for (const auto& [word, end] : kEnds) {
      if (!words.contains(word)) continue;
      pilot->state = PilotState::kEnded;
      pilot->end = end;
      pilot->reason = word;
    }
  }
}

// The elements of an array that wait: "3-5,8%2" is 3, 4, 5, 8. False if the text is something else.
bool ParseElements(const std::string& text, std::vector<int>* elements) {
  const std::string listed = text.substr(0, text.find('%'));
  for (const auto& part : absl::StrSplit(listed, ',')) {
    const std::vector<std::string> range_and_step = absl::StrSplit(part, ':');
    const std::vector<std::string> ends = absl::StrSplit(range_and_step[0], '-');
    int first = 0, last = 0, step = 1;
    if (ends.size() > 2 || range_and_step.size() > 2 || !absl::SimpleAtoi(ends.front(), &first) ||
        !absl::SimpleAtoi(ends.back(), &last) || first < 0 || last < first || last - first > kMaxElements ||
        (range_and_step.size() == 2 && (!absl::SimpleAtoi(range_and_step[1], &step) || step < 1))) {
      return false;
    }
    for (int element = first; element <= last; element += step) elements->push_back(element);
  }
  return true;
}

// The exit code in the forms of all versions; empty if the job has none.
std::string ExitText(const Json& job) {
  const Json& code = Field(job, "exit_code");
  double status = Number(job, "exit_code", 0);  // as of waitpid
  if (code.is_object() && Field(code, "return_code") != nullptr) status = 256 * Number(code, "return_code", 0);
  const int whole = static_cast<int>(status);
  if (whole >= 256) return absl::StrCat(", exit code ", whole / 256);
  return "";
}

}  // namespace

StatusOr<std::vector<Pilot>> ParseSlurmJobs(const std::string& text, const FleetFile& fleet, int64_t user_id) {
  const auto names = ClassesByJobName(fleet);
  TESSERA_ASSIGN_OR_RETURN(const Json list, ParseJobs(text, names));
  if (const Json& errors = Field(list, "errors"); errors.is_array() && !errors.empty()) {
    const std::string what = Text(errors.front(), "description");
    return NotAList("squeue reports an error: " + (what.empty() ? Text(errors.front(), "error") : what));
  }
  std::vector<Pilot> pilots;
  for (const Json& job : list["jobs"]) {
    const auto name = names.find(Text(job, "name"));
    const double id = Number(job, "job_id", 0);
    const std::set<std::string> states = StateWords(Field(job, "job_state"));
    if (Text(job, "name").empty() || id <= 0 || states.empty()) return NotAList("a job has no name, number or state");
    if (name == names.end() || static_cast<int64_t>(Number(job, "user_id", static_cast<double>(user_id))) != user_id) {
      continue;
    }
    Pilot pilot;
    pilot.pilot_class = name->second;
    pilot.submitted_s = Number(job, "submit_time", 0);
    pilot.started_s = Number(job, "start_time", 0);
    pilot.ended_s = Number(job, "end_time", 0);
    pilot.reason = Text(job, "state_reason");
    SetSlurmState(states, &pilot);
    if (pilot.state == PilotState::kEnded) absl::StrAppend(&pilot.reason, ExitText(job));
    if (pilot.state == PilotState::kRunning) pilot.reason.clear();
    const std::string job_id = absl::StrCat(static_cast<int64_t>(id));
    const std::string array_id = absl::StrCat(static_cast<int64_t>(Number(job, "array_job_id", 0)));
    const std::string waiting = Text(job, "array_task_string");
    std::vector<int> elements;
    if (!waiting.empty() && pilot.state != PilotState::kRunning) {
      // Elements that wait, or were cancelled while they did, are one record.
      if (!ParseElements(waiting, &elements)) return NotAList("the elements of an array are '" + waiting + "'");
    } else if (const double element = Number(job, "array_task_id", -1); array_id != "0" && element >= 0) {
      elements.push_back(static_cast<int>(element));
    }
    if (pilot.state != PilotState::kPending) pilot.allocation = job_id;
    for (const int element : elements) {
      pilot.job = absl::StrCat(array_id, "_", element);
      pilot.output = absl::StrCat(fleet.logs, "/", name->first, "-", pilot.job, ".out");
      pilots.push_back(pilot);
    }
    if (!elements.empty()) continue;
    pilot.job = job_id;
    pilots.push_back(std::move(pilot));
  }
  return pilots;
}

StatusOr<std::vector<Pilot>> ParseJobList(const std::string& text, const FleetFile& fleet) {
  static const std::map<std::string, std::pair<PilotState, PilotEnd>> kStates = {
      {"pending", {PilotState::kPending, PilotEnd::kSucceeded}},
      {"running", {PilotState::kRunning, PilotEnd::kSucceeded}},
      {"succeeded", {PilotState::kEnded, PilotEnd::kSucceeded}},
      {"failed", {PilotState::kEnded, PilotEnd::kFailed}},
      {"cancelled", {PilotState::kEnded, PilotEnd::kTakenAway}}};
  const auto names = ClassesByJobName(fleet);
  TESSERA_ASSIGN_OR_RETURN(const Json list, ParseJobs(text, names));
  std::vector<Pilot> pilots;
  for (const Json& job : list["jobs"]) {
    const auto name = names.find(Text(job, "name"));
    const auto state = kStates.find(Text(job, "state"));
    Pilot pilot;
    pilot.job = Text(job, "id");
    if (Text(job, "name").empty() || pilot.job.empty() || state == kStates.end()) {
      return NotAList(
          "a job has no id or name, or its state is none of pending, running, succeeded, failed, cancelled");
    }
    if (name == names.end()) continue;
    pilot.pilot_class = name->second;
    std::tie(pilot.state, pilot.end) = state->second;
    const std::string allocation = Text(job, "allocation");
    if (pilot.state != PilotState::kPending) pilot.allocation = allocation.empty() ? pilot.job : allocation;
    pilot.reason = Text(job, "reason");
    if (pilot.reason.empty() && pilot.state == PilotState::kEnded) pilot.reason = state->first;
    pilot.output = Text(job, "output");
    pilot.submitted_s = Number(job, "submitted", 0);
    pilot.started_s = Number(job, "started", 0);
    pilot.ended_s = Number(job, "ended", 0);
    pilots.push_back(std::move(pilot));
  }
  return pilots;
}

}  // namespace tessera
