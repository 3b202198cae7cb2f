#include "common/job/method_settings.h"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "common/job/exact_numbers.h"

namespace tessera {
namespace {

using json = nlohmann::basic_json<std::map, std::vector, std::string, bool, int64_t, uint64_t, double, std::allocator,
                                  ExactNumbers<nlohmann::adl_serializer>::Serializer>;

constexpr size_t kMaxLevels = 6;

Status Fault(const std::string& name, const std::string& found, const std::string& expected) {
  return absl::InvalidArgumentError(absl::StrCat(name, ": found ", found, ", expected ", expected));
}

template <class Number>
void CheckNumbers(std::span<const Setting<Number>> table, const MethodSettings& settings, Faults* faults) {
  for (const Setting<Number>& setting : table) {
    const std::optional<Number>& value = settings.*setting.value;
    // This form of the comparison also rejects NaN.
    if (!value || (*value >= setting.low && *value <= setting.high)) continue;
    faults->Add(Fault(setting.name, absl::StrCat(*value), absl::StrCat(setting.low, " to ", setting.high)));
  }
}

void CheckLevels(const std::string& method, const MethodSettings& settings, Faults* faults) {
  for (const ListSetting& setting : ListSettings()) {
    for (const int item : settings.*setting.value) {
      if (item >= setting.low && item <= setting.high) continue;
      faults->Add(Fault(setting.name, absl::StrCat(item), absl::StrCat(setting.low, " to ", setting.high)));
    }
  }
  const std::vector<int> levels = LevelsOf(settings), iterations = IterationsOf(method, settings);
  if (levels.size() > kMaxLevels ||
      std::adjacent_find(levels.begin(), levels.end(), std::less_equal<>()) != levels.end()) {
    faults->Add(Fault("levels", absl::StrJoin(levels, ","),
                      absl::StrCat("at most ", kMaxLevels, " levels, coarsest first, each once")));
  }
  if (levels.size() != iterations.size()) {
    faults->Add(
        Fault("iterations", absl::StrCat(iterations.size(), " numbers (", absl::StrJoin(iterations, ","), ")"),
              absl::StrCat("one for each of the ", levels.size(), " levels (", absl::StrJoin(levels, ","), ")")));
  }
}

}  // namespace

std::span<const Setting<double>> RealSettings() {
  static constexpr Setting<double> kSettings[] = {
      {"semantic", "Weight of the semantic data term (lambda 1), relative to the photo term; 0: off", 0, 100, 0,
       &MethodSettings::semantic},
      {"thin_plate",
       "Weight of smoothness (lambda 2), relative to the photo term's energy at a displacement of 1 pixel", 0, 100, 0.3,
       &MethodSettings::thin_plate},
      {"inter", "Weight of straight class boundaries (lambda 3); 0: off", 0, 100, 0, &MethodSettings::inter},
      {"contour", "Weight of silhouettes at image edges near class borders (lambda 4); 0: off", 0, 100, 0.5,
       &MethodSettings::contour},
      {"normal_prior", "Weight of the classes' normal priors in the labels (mu 1); 0: off", 0, 100, 0.35,
       &MethodSettings::normal_prior},
      {"label_smoothness", "Weight of short class boundaries in the labels (mu 2); 0: off", 0, 100, 0.25,
       &MethodSettings::label_smoothness},
      {"max_step_px", "Largest step of a vertex in one iteration, pixels of the level", 0.05, 4, 1,
       &MethodSettings::max_step_px}};
  return kSettings;
}

std::span<const Setting<int>> WholeSettings() {
  static constexpr Setting<int> kSettings[] = {
      {"window_px", "Side of the windows in which images are compared, pixels, odd", 3, 11, 7,
       &MethodSettings::window_px},
      {"partners", "Number of views with which each view is compared", 1, 16, 4, &MethodSettings::partners},
      {"views_per_direction",
       "Largest number of views of a ground cell from each of five directions (nadir and four sides)", 1, 1000, 8,
       &MethodSettings::views_per_direction}};
  return kSettings;
}

std::span<const ListSetting> ListSettings() {
  static const ListSetting kSettings[] = {
      {"levels",
       "Pyramid levels, coarsest first; level l halves the images l times",
       0,
       5,
       {2, 1, 0},
       &MethodSettings::levels},
      {"iterations",
       "Iterations of geometry, one number per level; later rounds of tessera have half",
       1,
       200,
       {4, 8, 6},
       &MethodSettings::iterations}};
  return kSettings;
}

std::span<const BoolSetting> BoolSettings() {
  static constexpr BoolSetting kSettings[] = {
      {"labels_first", "Solve the labels also before the first round", true, &MethodSettings::labels_first},
      {"flip_edges", "Flip edges of the published mesh where that makes creases straight", true,
       &MethodSettings::flip_edges}};
  return kSettings;
}

std::optional<std::string> MethodDefault(const std::string& setting, const std::string& method) {
  const bool labels_only = method == kLabelsMethod, paper = method == "paper", baseline = method == "baseline";
  const bool for_labels =
      setting == "normal_prior" || setting == "label_smoothness" || setting == "views_per_direction";
  if (labels_only && !for_labels) return std::nullopt;
  if (baseline && (setting == "semantic" || setting == "inter")) return std::nullopt;
  if ((paper || baseline) && setting == "contour") return "0";
  if (paper && setting == "semantic") return absl::StrCat(kPaperSemantic);
  if (paper && setting == "inter") return absl::StrCat(kPaperInter);
  if (paper && setting == "label_smoothness") return absl::StrCat(kPaperLabelSmoothness);
  if (setting == "iterations") return absl::StrJoin(IterationsOf(method, {}), ",");
  if ((paper || baseline) && (setting == "labels_first" || setting == "flip_edges")) return "false";
  for (const auto& each : RealSettings()) {
    if (setting == each.name) return absl::StrCat(each.standard);
  }
  for (const auto& each : WholeSettings()) {
    if (setting == each.name) return absl::StrCat(each.standard);
  }
  for (const ListSetting& each : ListSettings()) {
    if (setting == each.name) return absl::StrJoin(each.standard, ",");
  }
  for (const BoolSetting& each : BoolSettings()) {
    if (setting == each.name) return each.standard ? "true" : "false";
  }
  return std::nullopt;
}

std::vector<int> LevelsOf(const MethodSettings& settings) {
  return settings.levels.empty() ? ListSettings()[0].standard : settings.levels;
}

std::vector<int> IterationsOf(const std::string& method, const MethodSettings& settings) {
  if (!settings.iterations.empty()) return settings.iterations;
  if (method == "paper" || method == "baseline") return {kIterationsOfOneSplit.begin(), kIterationsOfOneSplit.end()};
  return ListSettings()[1].standard;
}

Status CheckMethod(const std::string& method, const MethodSettings& settings) {
  Faults faults;
  if (!method.empty() && std::find(kMethods.begin(), kMethods.end(), method) == kMethods.end()) {
    faults.Add(Fault("method", absl::StrCat("\"", method, "\""), absl::StrJoin(kMethods, ", ")));
  }
  CheckNumbers(RealSettings(), settings, &faults);
  CheckNumbers(WholeSettings(), settings, &faults);
  if (settings.window_px && *settings.window_px % 2 == 0) {
    faults.Add(Fault("window_px", absl::StrCat(*settings.window_px), "an odd number"));
  }
  CheckLevels(method, settings, &faults);
  if (method == "baseline" && (settings.semantic || settings.inter)) {
    faults.Add(
        Fault(settings.semantic ? "semantic" : "inter", "a weight", "no value: the method baseline uses no classes"));
  }
  if (method == kLabelsMethod) {
    MethodSettings taken;  // views_per_direction selects the views that vote for labels
    taken.normal_prior = settings.normal_prior;
    taken.label_smoothness = settings.label_smoothness;
    taken.views_per_direction = settings.views_per_direction;
    if (settings != taken) {
      faults.Add(
          Fault("method settings", "settings of the geometry",
                "only normal_prior, label_smoothness and views_per_direction: the method labels moves no vertices"));
    }
  }
  return faults.ToStatus();
}

std::string ToJson(const MethodSettings& settings) {
  json out = json::object();
  for (const auto& setting : RealSettings()) {
    if (settings.*setting.value) out[setting.name] = *(settings.*setting.value);
  }
  for (const auto& setting : WholeSettings()) {
    if (settings.*setting.value) out[setting.name] = *(settings.*setting.value);
  }
  for (const ListSetting& setting : ListSettings()) {
    if (!(settings.*setting.value).empty()) out[setting.name] = settings.*setting.value;
  }
  for (const BoolSetting& setting : BoolSettings()) {
    if (settings.*setting.value) out[setting.name] = *(settings.*setting.value);
  }
  return out.dump();
}

StatusOr<MethodSettings> ParseMethodSettings(const std::string& text) {
  MethodSettings settings;
  try {
    json in = json::parse(text);
    const auto take = [&in](const char* name, auto* value) {
      if (!in.contains(name)) return;
      in.at(name).get_to(*value);
      in.erase(name);
    };
    const auto take_optional = [&take, &in](const char* name, auto* value) {
      if (in.contains(name)) take(name, &value->emplace());
    };
    for (const auto& setting : RealSettings()) take_optional(setting.name, &(settings.*setting.value));
    for (const auto& setting : WholeSettings()) take_optional(setting.name, &(settings.*setting.value));
    for (const ListSetting& setting : ListSettings()) take(setting.name, &(settings.*setting.value));
    for (const BoolSetting& setting : BoolSettings()) take_optional(setting.name, &(settings.*setting.value));
    if (!in.is_object() || !in.empty()) {
      return absl::InvalidArgumentError(absl::StrCat("method settings: found unknown keys: ", in.dump()));
    }
  } catch (const json::exception& e) {
    return absl::InvalidArgumentError(absl::StrCat("method settings: ", e.what()));
  }
  return settings;
}

}  // namespace tessera
