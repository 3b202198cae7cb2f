// What a user may change of how tiles are refined: the method and its numbers, with their limits.
#ifndef TESSERA_COMMON_JOB_METHOD_SETTINGS_H_
#define TESSERA_COMMON_JOB_METHOD_SETTINGS_H_

#include <array>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// tessera: ours. baseline: Vu et al. 2012, images alone. paper: Bláha et al. 2017, its terms and rounds. labels: no
// vertex moves, labels are solved once.
inline constexpr std::array<const char*, 4> kMethods = {"tessera", "baseline", "paper", "labels"};
inline constexpr const char* kLabelsMethod = "labels";

// What is not set (empty for lists) is as the method has it.
struct MethodSettings {
  std::optional<double> semantic, thin_plate, inter, contour;  // λ1 to λ4
  std::optional<double> normal_prior, label_smoothness;        // μ1, μ2
  std::optional<double> max_step_px;
  std::optional<int> window_px, partners, views_per_direction;
  std::optional<bool> labels_first, flip_edges;
  std::vector<int> levels, iterations;

  friend bool operator==(const MethodSettings&, const MethodSettings&) = default;
};

// A number among the settings. `name` is what files, messages and (with dashes) the command line call it; `standard`
// what the method "tessera" has.
template <class Number>
struct Setting {
  const char* name;
  const char* meaning;  // for people, with the unit
  Number low, high, standard;
  std::optional<Number> MethodSettings::*value;
};

// A list of whole numbers among them, one a pyramid level.
struct ListSetting {
  const char* name;
  const char* meaning;
  int low, high;  // of each item
  std::vector<int> standard;
  std::vector<int> MethodSettings::*value;
};

struct BoolSetting {
  const char* name;
  const char* meaning;
  bool standard;
  std::optional<bool> MethodSettings::*value;
};

std::span<const Setting<double>> RealSettings();
std::span<const Setting<int>> WholeSettings();
std::span<const ListSetting> ListSettings();
std::span<const BoolSetting> BoolSettings();

// INVALID_ARGUMENT with every fault, each with what was found and what was expected. An empty method is "tessera".
Status CheckMethod(const std::string& method, const MethodSettings& settings);

// Canonical JSON of what is set.
std::string ToJson(const MethodSettings& settings);
// INVALID_ARGUMENT if something is unknown or of a wrong type; limits are CheckMethod's.
StatusOr<MethodSettings> ParseMethodSettings(const std::string& json);

}  // namespace tessera

#endif  // TESSERA_COMMON_JOB_METHOD_SETTINGS_H_
