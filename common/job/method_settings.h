// The refinement method and its settings, with their limits, as users can set them.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// tessera: the default method. baseline: Vu et al. 2012, photo-consistency without labels. paper: Bláha et al. 2017,
// with its terms and rounds. labels: moves no vertices and solves the labels once.
inline constexpr std::array<const char*, 4> kMethods = {"tessera", "baseline", "paper", "labels"};
inline constexpr const char* kLabelsMethod = "labels";

// What each of kMethods does, for people.
inline constexpr std::array<const char*, 4> kMethodHelps = {
    "The default: geometry and labels in turn, with straight creases and class borders",
    "Vu et al. 2012: geometry from images alone", "Blaha et al. 2017: its terms and rounds",
    "Solves the labels once and moves no vertices"};

// Values of the method "paper" that differ from the standard ones; the paper gives no weights.
inline constexpr double kPaperSemantic = 0.1, kPaperInter = 0.1, kPaperLabelSmoothness = 0.5;

// Iterations of "paper" and "baseline", which split faces once.
inline constexpr std::array<int, 3> kIterationsOfOneSplit = {4, 8, 8};

// Settings that are not set (or empty lists) have the method's default.
struct MethodSettings {
  std::optional<double> semantic, thin_plate, inter, contour;  // λ1 to λ4
  std::optional<double> normal_prior, label_smoothness;        // μ1, μ2
  std::optional<double> max_step_px;
  std::optional<int> window_px, partners, views_per_direction;
  std::optional<bool> labels_first, flip_edges;
  std::vector<int> levels, iterations;

  friend bool operator==(const MethodSettings&, const MethodSettings&) = default;
};

// Describes a numeric setting. `name` is used in files, messages and (with dashes) on the command line; `standard` is
// the default of the method "tessera".
template <class Number>
struct Setting {
  const char* name;
  const char* meaning;  // help text with the unit
  Number low, high, standard;
  std::optional<Number> MethodSettings::*value;
};

// Describes a setting that is a list of integers, one per pyramid level.
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

// The value that the method has if the setting of this name in one of the tables is not set, as text: "0.3", "2,1,0",
// "true". None if the method does not use the setting or has no setting of this name.
std::optional<std::string> MethodDefault(const std::string& setting, const std::string& method);

// The setting, or the method's default.
std::vector<int> LevelsOf(const MethodSettings& settings);
std::vector<int> IterationsOf(const std::string& method, const MethodSettings& settings);

// INVALID_ARGUMENT lists all errors, each with what was found and what was expected. An empty method means "tessera".
Status CheckMethod(const std::string& method, const MethodSettings& settings);

// Canonical JSON of the settings that are set.
std::string ToJson(const MethodSettings& settings);
// INVALID_ARGUMENT for unknown keys and wrong types. CheckMethod checks limits.
StatusOr<MethodSettings> ParseMethodSettings(const std::string& json);

}  // namespace tessera
