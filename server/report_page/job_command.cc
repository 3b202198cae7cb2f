#include "server/report_page/job_command.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "server/settings/settings_proto.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

std::string FlagOf(const char* setting, const std::string& value) {
  return absl::StrCat(" --", absl::StrReplaceAll(setting, {{"_", "-"}}), "=", ShellWord(value));
}

std::string SettingFlags(const MethodSettings& settings) {
  std::string flags;
  for (const auto& setting : RealSettings()) {
    if (const auto& value = settings.*setting.value) flags += FlagOf(setting.name, absl::StrCat(*value));
  }
  for (const auto& setting : WholeSettings()) {
    if (const auto& value = settings.*setting.value) flags += FlagOf(setting.name, absl::StrCat(*value));
  }
  for (const ListSetting& setting : ListSettings()) {
    const std::vector<int>& values = settings.*setting.value;
    if (!values.empty()) flags += FlagOf(setting.name, absl::StrJoin(values, ","));
  }
  for (const BoolSetting& setting : BoolSettings()) {
    if (const auto& value = settings.*setting.value) flags += FlagOf(setting.name, *value ? "true" : "false");
  }
  return flags;
}

}  // namespace

std::string ShellWord(std::string_view text) {
  const bool plain = !text.empty() && std::all_of(text.begin(), text.end(), [](unsigned char c) {
    return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') ||
           std::string_view("_./:,+@%-").find(static_cast<char>(c)) != std::string_view::npos;
  });
  if (plain) return std::string(text);
  std::string word = "'";
  for (const char c : text) word += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return word + "'";
}

std::string RunCommandOf(const v1::Job& job) {
  const JobSettings settings = FromProto(job.settings());
  const UpdateSettings& update = settings.update;
  if (!update.rollback_to.empty() || update.plan_only) return "";
  std::string command = absl::StrCat("tessera run ", ShellWord(job.scene_path()));
  if (!update.base.empty()) {  // the other settings are those of the base job
    command += FlagOf("base", update.base);
    for (const std::string& flight : update.withdraw) command += FlagOf("withdraw", flight);
    if (update.all_epochs) command += FlagOf("epochs", "all");
    if (update.from_scratch) command += " --from-scratch";
    return command + " --out OUT";
  }
  if (settings.method != JobSettings().method) command += FlagOf("method", settings.method);
  if (settings.tiles > 0) command += FlagOf("tiles", absl::StrCat(settings.tiles));
  if (settings.tile_memory_bytes > 0) command += FlagOf("tile_memory", absl::StrCat(settings.tile_memory_bytes));
  if (settings.rounds > 0) command += FlagOf("rounds", absl::StrCat(settings.rounds));
  command += SettingFlags(settings.method_settings);
  if (!settings.classifier.empty()) command += FlagOf("classifier", settings.classifier);
  if (settings.skip_images > 0) command += FlagOf("skip_images", absl::StrCat(settings.skip_images));
  if (settings.anyway) command += " --anyway";
  return command + " --out OUT";
}

}  // namespace tessera
