#include "server/fleet/fleet_file.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "common/base/json_bounds.h"

namespace tessera {
namespace {

using Json = nlohmann::json;
using Words = std::vector<std::string>;

constexpr size_t kMaxClasses = 32;  // of Workers.GetDemand
constexpr int kMaxPilots = 1000;    // of a class; an array of Slurm has 1,000 elements by default
constexpr double kMaxSeconds = 1e8;

// The exit code of `scancel` does not matter: a job may have ended. `--state` protects one that has just started.
const SchedulerCommands& SlurmCommands() {
  static const SchedulerCommands commands = {
      {"sbatch", "--parsable", "--array=1-{count}", "--job-name={job}", "--nodes=1", "--ntasks=1",
       "--cpus-per-task={cores}", "--mem={memory_mib}M", "--time={time_limit_min}", "--output={logs}/%x-%A_%a.out",
       "--open-mode=append", "--no-requeue", "{options}", "{pilot}", "{worker}"},
      {"squeue", "--json", "--states=all", "--user={user}", "--name={names}"},
      {"scancel", "--state=PENDING", "{jobs}"},
      true};
  return commands;
}

const std::map<std::string, std::set<std::string>>& KnownPlaceholders() {
  static const std::map<std::string, std::set<std::string>> known = {
      {"submit", {"name", "class", "job", "count", "memory_mib", "cores", "time_limit_min", "logs", "pilot"}},
      {"list", {"name", "names", "user"}},
      {"cancel", {"name"}}};
  return known;
}
// Placeholders that stand for several words.
const std::map<std::string, std::set<std::string>>& KnownLists() {
  static const std::map<std::string, std::set<std::string>> known = {
      {"submit", {"options", "worker"}}, {"list", {}}, {"cancel", {"jobs"}}};
  return known;
}

std::string FoundText(const Json& value) {
  const std::string text = value.dump(-1, ' ', false, Json::error_handler_t::replace);
  return text.size() <= 60 ? text : text.substr(0, 57) + "...";
}

bool IsPlainName(const std::string& name) {
  return !name.empty() && name.size() <= 40 && std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_';
  });
}

// Reads the fields of one object of the file.
class FieldReader {
 public:
  FieldReader(const Json& object, std::string place, const std::string& file, Faults* faults)
      : object_(object), place_(std::move(place)), file_(file), faults_(*faults) {}

  // Null, with a fault if it is required, if the field is absent.
  const Json* Find(const std::string& field, bool required = false) {
    known_.push_back(field);
    const auto it = object_.find(field);
    if (it != object_.end()) return &*it;
    if (required) faults_.Add(InputError(file_, place_, absl::StrCat("no field '", field, "'"), "this field"));
    return nullptr;
  }
  std::string Place(const std::string& field) const {
    return place_.empty() ? field : absl::StrCat(place_, ".", field);
  }
  void Fault(const std::string& field, const Json& found, const std::string& expected) {
    faults_.Add(InputError(file_, Place(field), FoundText(found), expected));
  }
  void Name(const std::string& field, std::string* out) {
    const Json* value = Find(field, /*required=*/true);
    if (value == nullptr) return;
    if (value->is_string() && IsPlainName(value->get<std::string>())) {
      *out = value->get<std::string>();
    } else {
      Fault(field, *value, "1 to 40 letters, digits, '-' and '_'");
    }
  }
  void Path(const std::string& field, bool required, std::string* out) {
    const Json* value = Find(field, required);
    if (value == nullptr) return;
    if (value->is_string() && value->get<std::string>().starts_with('/')) {
      *out = value->get<std::string>();
    } else {
      Fault(field, *value, "an absolute path, as it is on the machines of the pilots");
    }
  }
  void Whole(const std::string& field, bool required, int low, int high, int* out) {
    const Json* value = Find(field, required);
    if (value == nullptr) return;
    if (value->is_number_integer() && *value >= low && *value <= high) {
      *out = value->get<int>();
    } else {
      Fault(field, *value, absl::StrCat("a whole number from ", low, " to ", high));
    }
  }
  void Seconds(const std::string& field, bool required, double low, double* out) {
    const Json* value = Find(field, required);
    if (value == nullptr) return;
    if (value->is_number() && value->get<double>() >= low && value->get<double>() <= kMaxSeconds) {
      *out = value->get<double>();
    } else {
      Fault(field, *value, absl::StrCat("seconds, ", low, " or more"));
    }
  }
  // Bytes as a number, or a text such as "16GiB".
  void Memory(const std::string& field, int64_t* mib) {
    const Json* value = Find(field, /*required=*/true);
    if (value == nullptr) return;
    double bytes = -1;
    if (value->is_number()) bytes = value->get<double>();
    if (value->is_string()) {
      const std::string text = value->get<std::string>();
      char* unit = nullptr;
      const double number = std::strtod(text.c_str(), &unit);
      static const std::map<std::string, double> kUnits = {{"MiB", 1 << 20}, {"GiB", 1 << 30}, {"TiB", 0x1p40}};
      const auto known = kUnits.find(unit);
      if (unit != text.c_str() && known != kUnits.end()) bytes = number * known->second;
    }
    if (bytes >= 0x1p28 && bytes <= 0x1p46) {
      *mib = static_cast<int64_t>(bytes / 0x1p20);
    } else {
      Fault(field, *value, "bytes or a text such as \"16GiB\" (MiB, GiB, TiB), 256 MiB to 64 TiB");
    }
  }
  void WordList(const std::string& field, bool required, size_t least, Words* out) {
    const Json* value = Find(field, required);
    if (value == nullptr) return;
    if (!value->is_array() || value->size() < least ||
        !std::all_of(value->begin(), value->end(), [](const Json& word) { return word.is_string(); })) {
      Fault(field, *value, least == 0 ? "a list of words" : "a list of words, the first of which is a program");
      return;
    }
    *out = value->get<Words>();
  }
  void RejectOthers() {
    for (const auto& [field, value] : object_.items()) {
      if (std::find(known_.begin(), known_.end(), field) != known_.end()) continue;
      faults_.Add(InputError(file_, place_, absl::StrCat("unknown field '", field, "'"),
                             absl::StrCat("one of ", absl::StrJoin(known_, ", "))));
    }
  }

 private:
  const Json& object_;
  const std::string place_;
  const std::string& file_;
  Faults& faults_;
  Words known_;
};

void CheckPlaceholders(const std::string& command, const Words& words, FieldReader* in) {
  const auto& plain = KnownPlaceholders().at(command);
  const auto& lists = KnownLists().at(command);
  for (const std::string& word : words) {
    if (word.size() > 2 && word.front() == '{' && word.back() == '}' &&
        lists.contains(word.substr(1, word.size() - 2))) {
      continue;
    }
    for (size_t at = word.find('{'); at != std::string::npos; at = word.find('{', at + 1)) {
      const size_t end = word.find('}', at);
      if (end != std::string::npos && plain.contains(word.substr(at + 1, end - at - 1))) continue;
      in->Fault(command, word,
                absl::StrCat("the placeholders {", absl::StrJoin(plain, "}, {"), "}",
                             lists.empty() ? "" : " or, as words of their own, {", absl::StrJoin(lists, "}, {"),
                             lists.empty() ? "" : "}"));
      break;
    }
  }
}

void ReadScheduler(const Json& value, FieldReader* in, const std::string& file, Faults* faults,
                   SchedulerCommands* commands) {
  if (value == "slurm") {
    *commands = SlurmCommands();
  } else if (value.is_object()) {
    FieldReader own(value, "scheduler", file, faults);
    const std::pair<const char*, Words*> fields[] = {
        {"submit", &commands->submit}, {"list", &commands->list}, {"cancel", &commands->cancel}};
    for (const auto& [field, words] : fields) {
      own.WordList(field, /*required=*/true, 1, words);
      CheckPlaceholders(field, *words, &own);
    }
    own.RejectOthers();
  } else {
    in->Fault("scheduler", value, "\"slurm\" or an object with the commands submit, list and cancel");
  }
}

PilotClass ReadClass(const Json& value, const std::string& place, const std::string& file, Faults* faults) {
  PilotClass pilots;
  if (!value.is_object()) {
    faults->Add(InputError(file, place, FoundText(value), "an object with the fields of a class"));
    return pilots;
  }
  FieldReader in(value, place, file, faults);
  in.Name("name", &pilots.name);
  in.Memory("memory", &pilots.memory_mib);
  in.Whole("cores", false, 1, 1024, &pilots.cores);
  in.Seconds("time_limit_s", true, 60, &pilots.time_limit_s);
  in.Whole("most", true, 1, kMaxPilots, &pilots.most);
  in.Whole("least", false, 0, pilots.most, &pilots.least);
  pilots.most_pending = pilots.most;
  in.Whole("most_pending", false, 1, kMaxPilots, &pilots.most_pending);
  in.WordList("options", false, 0, &pilots.options);
  in.RejectOthers();
  return pilots;
}

void ReadClasses(const Json& value, FieldReader* in, const std::string& file, Faults* faults,
                 std::vector<PilotClass>* classes) {
  if (!value.is_array() || value.empty() || value.size() > kMaxClasses) {
    in->Fault("classes", value, absl::StrCat("a list of 1 to ", kMaxClasses, " classes"));
    return;
  }
  std::set<std::string> names;
  std::set<int64_t> memories;
  for (size_t i = 0; i < value.size(); ++i) {
    const std::string place = absl::StrCat("classes[", i, "]");
    PilotClass pilots = ReadClass(value[i], place, file, faults);
    if (!pilots.name.empty() && !names.insert(pilots.name).second) {
      faults->Add(InputError(file, place + ".name", "'" + pilots.name + "' again", "each name once"));
    }
    if (pilots.memory_mib > 0 && !memories.insert(pilots.memory_mib).second) {
      faults->Add(InputError(file, place + ".memory", absl::StrCat(pilots.memory_mib, " MiB again"),
                             "another memory for each class"));
    }
    classes->push_back(std::move(pilots));
  }
  std::sort(classes->begin(), classes->end(),
            [](const PilotClass& a, const PilotClass& b) { return a.memory_mib < b.memory_mib; });
}

int64_t WholeMinutes(const PilotClass& pilots) { return static_cast<int64_t>(pilots.time_limit_s / 60); }

Words Filled(const Words& words, const std::map<std::string, std::string>& values,
             const std::map<std::string, Words>& lists) {
  Words filled;
  for (const std::string& word : words) {
    const auto list = word.size() > 2 ? lists.find(word.substr(1, word.size() - 2)) : lists.end();
    if (list != lists.end() && word.front() == '{' && word.back() == '}') {
      filled.insert(filled.end(), list->second.begin(), list->second.end());
      continue;
    }
    std::string text;
    for (size_t at = 0; at < word.size();) {
      const size_t end = word[at] == '{' ? word.find('}', at) : std::string::npos;
      const auto value = end == std::string::npos ? values.end() : values.find(word.substr(at + 1, end - at - 1));
      if (value == values.end()) {
        text += word[at++];
      } else {
        text += value->second;
        at = end + 1;
      }
    }
    filled.push_back(std::move(text));
  }
  return filled;
}

}  // namespace

int64_t WorkerMemory_mib(const PilotClass& pilots) {
  return pilots.memory_mib - std::max<int64_t>(64, pilots.memory_mib / 20);
}

double WorkerTime_s(const PilotClass& pilots) {
  const double limit_s = 60.0 * static_cast<double>(WholeMinutes(pilots));
  return limit_s - std::min(60.0, limit_s / 10);
}

StatusOr<FleetFile> ParseFleetFile(const std::string& path, const std::string& text) {
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth(path, text));
  Json json;
  try {
    json = Json::parse(text);
  } catch (const Json::parse_error& error) {
    return InputError(path, absl::StrCat("byte ", error.byte), "a syntax error", "JSON");
  }
  if (!json.is_object()) return InputError(path, "", FoundText(json), "an object");
  FleetFile fleet;
  Faults faults;
  FieldReader in(json, "", path, &faults);
  in.Name("name", &fleet.name);
  if (const Json* value = in.Find("scheduler", /*required=*/true)) {
    ReadScheduler(*value, &in, path, &faults, &fleet.commands);
  }
  in.Path("pilot", fleet.commands.lists_as_squeue, &fleet.pilot);
  in.WordList("worker", false, 1, &fleet.worker);
  in.WordList("options", false, 0, &fleet.options);
  in.Path("logs", false, &fleet.logs);
  in.Seconds("worth_s", false, 1, &fleet.worth_s);
  in.Seconds("interval_s", false, 1, &fleet.interval_s);
  in.Seconds("command_s", false, 1, &fleet.command_s);
  if (const Json* value = in.Find("classes", /*required=*/true)) {
    ReadClasses(*value, &in, path, &faults, &fleet.classes);
  }
  in.RejectOthers();
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  return fleet;
}

std::string JobName(const FleetFile& fleet, const PilotClass& pilots) {
  return absl::StrCat("tessera.", fleet.name, ".", pilots.name);
}

Words SubmitWords(const FleetFile& fleet, const PilotClass& pilots, int count) {
  Words options = fleet.options;
  options.insert(options.end(), pilots.options.begin(), pilots.options.end());
  return Filled(fleet.commands.submit,
                {{"name", fleet.name},
                 {"class", pilots.name},
                 {"job", JobName(fleet, pilots)},
                 {"count", absl::StrCat(count)},
                 {"memory_mib", absl::StrCat(pilots.memory_mib)},
                 {"cores", absl::StrCat(pilots.cores)},
                 {"time_limit_min", absl::StrCat(WholeMinutes(pilots))},
                 {"logs", fleet.logs},
                 {"pilot", fleet.pilot}},
                {{"options", std::move(options)}, {"worker", fleet.worker}});
}

Words ListWords(const FleetFile& fleet, const std::string& user) {
  const std::string names = absl::StrJoin(
      fleet.classes, ",", [&](std::string* out, const PilotClass& pilots) { out->append(JobName(fleet, pilots)); });
  return Filled(fleet.commands.list, {{"name", fleet.name}, {"names", names}, {"user", user}}, {});
}

Words CancelWords(const FleetFile& fleet, const Words& jobs) {
  return Filled(fleet.commands.cancel, {{"name", fleet.name}}, {{"jobs", jobs}});
}

}  // namespace tessera
