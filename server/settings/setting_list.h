// The settings of a job as a list, for forms.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace tessera {

// Has the numbers of tessera.v1.SettingKind.
enum class SettingKind {
  kNumber = 1,
  kInteger = 2,
  kBoolean = 3,
  kText = 4,
  kList = 5,      // of integers
  kChoice = 6,    // one of `choices`
  kChoices = 7,   // any of `choices`
  kTextList = 8,  // of texts
};

// A field of JobSettings that a user may set.
struct ListedSetting {
  std::string name;   // as on the command line, with underscores
  std::string field;  // path of the field in v1.JobSettings, in JSON names: "methodSettings.thinPlate"
  std::string help;
  SettingKind kind = SettingKind::kText;
  std::optional<double> minimum, maximum;       // of a number, or of each item of a list
  std::string unit = {};                        // "px", "m", "bytes", "core-seconds"; empty: none
  std::map<std::string, std::string> defaults;  // by method; a method without an entry does not use the setting
  std::vector<std::string> choices = {};
};

// In the order of a form: tiles, method, its settings, scene, update, export. CheckJobSettings accepts each setting
// within its limits unless others contradict it. Thread-safe.
std::vector<ListedSetting> ListedSettings();

}  // namespace tessera
