// The list of settings says what CheckJobSettings accepts.
#include "server/settings/setting_list.h"

#include <gmock/gmock.h>
#include <google/protobuf/util/json_util.h>
#include <gtest/gtest.h>

#include <set>

#include "absl/strings/str_cat.h"
#include "server/settings/job_settings.h"
#include "server/settings/settings_proto.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

// The settings with one field at this JSON value, the rest as in `given`.
StatusOr<JobSettings> With(const std::string& field, const std::string& value, const std::string& given = "") {
  const size_t dot = field.find('.');
  std::string json = dot == std::string::npos
                         ? absl::StrCat("\"", field, "\":", value)
                         : absl::StrCat("\"", field.substr(0, dot), "\":{\"", field.substr(dot + 1), "\":", value, "}");
  if (!given.empty()) absl::StrAppend(&json, ",", given);
  v1::JobSettings proto;
  const auto parsed = google::protobuf::util::JsonStringToMessage(absl::StrCat("{", json, "}"), &proto);
  if (!parsed.ok()) return absl::InvalidArgumentError(absl::StrCat("no such field: ", json));
  return FromProto(proto);
}

// The value in JSON as the kind has it.
std::string JsonOf(const ListedSetting& setting, double value) {
  const std::string number = absl::StrCat(
      setting.kind == SettingKind::kNumber ? absl::StrCat(value) : absl::StrCat(static_cast<int64_t>(value)));
  return setting.kind == SettingKind::kList ? absl::StrCat("[", number, "]") : number;
}

TEST(SettingListTest, EveryFieldExistsInTheMessage) {
  const std::map<SettingKind, std::string> examples = {
      {SettingKind::kNumber, "0.5"},      {SettingKind::kInteger, "2"},       {SettingKind::kBoolean, "true"},
      {SettingKind::kText, "\"a\""},      {SettingKind::kList, "[1]"},        {SettingKind::kChoice, "\"a\""},
      {SettingKind::kChoices, "[\"a\"]"}, {SettingKind::kTextList, "[\"a\"]"}};
  for (const ListedSetting& setting : ListedSettings()) {
    EXPECT_TRUE(With(setting.field, examples.at(setting.kind)).ok()) << setting.field;
  }
}

TEST(SettingListTest, EverySettingOfTheMethodIsListed) {
  std::set<std::string> names;
  for (const ListedSetting& setting : ListedSettings()) names.insert(setting.name);
  for (const auto& row : RealSettings()) EXPECT_TRUE(names.contains(row.name)) << row.name;
  for (const auto& row : WholeSettings()) EXPECT_TRUE(names.contains(row.name)) << row.name;
  for (const auto& row : ListSettings()) EXPECT_TRUE(names.contains(row.name)) << row.name;
  for (const auto& row : BoolSettings()) EXPECT_TRUE(names.contains(row.name)) << row.name;
}

TEST(SettingListTest, ValuesAtTheLimitsAreAcceptedAndBeyondThemRefused) {
  for (const ListedSetting& setting : ListedSettings()) {
    if (!setting.minimum) continue;
    // Lists need one number a level; export settings are checked with formats only.
    if (setting.kind == SettingKind::kList || setting.field.starts_with("export.")) continue;
    const auto low = With(setting.field, JsonOf(setting, *setting.minimum));
    ASSERT_TRUE(low.ok()) << low.status();
    EXPECT_TRUE(CheckJobSettings(*low).ok()) << setting.name << ": " << CheckJobSettings(*low);
    const double step = setting.kind == SettingKind::kNumber ? 0.01 : 1;
    EXPECT_FALSE(CheckJobSettings(*With(setting.field, JsonOf(setting, *setting.minimum - step))).ok()) << setting.name;
    if (!setting.maximum) continue;
    const auto high = With(setting.field, JsonOf(setting, *setting.maximum));
    EXPECT_TRUE(CheckJobSettings(*high).ok()) << setting.name << ": " << CheckJobSettings(*high);
    EXPECT_FALSE(CheckJobSettings(*With(setting.field, JsonOf(setting, *setting.maximum + step))).ok()) << setting.name;
  }
}

TEST(SettingListTest, ChoicesAreAcceptedAndOthersRefused) {
  for (const ListedSetting& setting : ListedSettings()) {
    if (setting.choices.empty() || setting.field.starts_with("export.")) continue;
    for (const std::string& choice : setting.choices) {
      EXPECT_TRUE(CheckJobSettings(*With(setting.field, absl::StrCat("\"", choice, "\""))).ok()) << choice;
    }
    EXPECT_FALSE(CheckJobSettings(*With(setting.field, "\"other\"")).ok()) << setting.name;
  }
}

// Setting a default changes nothing but the field itself, so it is valid with its method.
TEST(SettingListTest, DefaultsOfAMethodAreValidWithIt) {
  for (const ListedSetting& setting : ListedSettings()) {
    if (!setting.field.starts_with("methodSettings.") || setting.kind == SettingKind::kList) continue;
    for (const char* const method : kMethods) {
      const std::string of_method = absl::StrCat("\"method\":\"", method, "\"");
      const auto found = setting.defaults.find(method);
      if (found != setting.defaults.end()) {
        const auto settings = With(setting.field, found->second, of_method);
        ASSERT_TRUE(settings.ok()) << settings.status();
        EXPECT_TRUE(CheckJobSettings(*settings).ok()) << setting.name << " " << method;
      } else {
        const std::string value = setting.kind == SettingKind::kBoolean ? "true" : JsonOf(setting, *setting.maximum);
        EXPECT_FALSE(CheckJobSettings(*With(setting.field, value, of_method)).ok()) << setting.name << " " << method;
      }
    }
  }
}

}  // namespace
}  // namespace tessera
