#include "common/job/method_settings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "common/job/task_parameters.h"

namespace tessera {
namespace {

using testing::HasSubstr;

// Every setting, with an allowed value.
MethodSettings AllSet() {
  MethodSettings settings;
  for (const auto& setting : RealSettings()) settings.*setting.value = setting.low + 1.0 / 3;
  for (const auto& setting : WholeSettings()) settings.*setting.value = setting.low;
  settings.levels = {3, 1};
  settings.iterations = {4, 5};
  for (const BoolSetting& setting : BoolSettings()) settings.*setting.value = !setting.standard;
  return settings;
}

TEST(MethodSettings, JsonContainsOnlyTheValuesThatAreSet) {
  EXPECT_EQ(ToJson(MethodSettings()), "{}");
  MethodSettings one;
  one.partners = 6;
  EXPECT_EQ(ToJson(one), R"({"partners":6})");
  for (const MethodSettings& settings : {MethodSettings(), one, AllSet()}) {
    const auto parsed = ParseMethodSettings(ToJson(settings));
    ASSERT_TRUE(parsed.ok()) << parsed.status();
    EXPECT_EQ(*parsed, settings);
  }
}

TEST(MethodSettings, RejectsForeignJson) {
  for (const char* text : {"", "[]", "[1]", "{\"thick_plate\":1}", "{\"window_px\":\"7\"}", "{\"levels\":3}"}) {
    EXPECT_EQ(ParseMethodSettings(text).status().code(), absl::StatusCode::kInvalidArgument) << text;
  }
}

// Both ends of every range are accepted, values outside are rejected with the found and the expected value.
TEST(MethodSettings, ChecksRanges) {
  const auto refused = [](const MethodSettings& settings, const std::string& name) {
    const Status status = CheckMethod("tessera", settings);
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << name;
    EXPECT_THAT(std::string(status.message()), HasSubstr(name + ": found "));
    EXPECT_THAT(std::string(status.message()), HasSubstr("expected "));
  };
  for (const auto& setting : RealSettings()) {
    MethodSettings settings;
    for (const double inside : {setting.low, setting.standard, setting.high}) {
      settings.*setting.value = inside;
      EXPECT_TRUE(CheckMethod("tessera", settings).ok()) << setting.name << " " << inside;
    }
    for (const double outside : {std::nextafter(setting.low, -1e9), std::nextafter(setting.high, 1e9), std::nan("")}) {
      settings.*setting.value = outside;
      refused(settings, setting.name);
    }
  }
  for (const auto& setting : WholeSettings()) {
    MethodSettings settings;
    for (const int inside : {setting.low, setting.standard, setting.high}) {
      settings.*setting.value = inside;
      EXPECT_TRUE(CheckMethod("tessera", settings).ok()) << setting.name << " " << inside;
    }
    for (const int outside : {setting.low - 1, setting.high + 1}) {
      settings.*setting.value = outside;
      refused(settings, setting.name);
    }
  }
  for (const ListSetting& setting : ListSettings()) {
    MethodSettings settings;
    settings.levels = ListSettings()[0].standard;
    settings.iterations = ListSettings()[1].standard;
    EXPECT_TRUE(CheckMethod("tessera", settings).ok());
    (settings.*setting.value)[0] = setting.high + 1;
    refused(settings, setting.name);
    (settings.*setting.value)[0] = setting.low - 1;
    refused(settings, setting.name);
  }
}

TEST(MethodSettings, RejectsInconsistentSettings) {
  MethodSettings even, longer, rising, semantic;
  even.window_px = 6;
  longer.iterations = {5, 5, 5, 5};
  rising.levels = {0, 1, 2};
  semantic.semantic = 0.5;
  for (const MethodSettings& settings : {even, longer, rising}) EXPECT_FALSE(CheckMethod("tessera", settings).ok());
  longer.levels = {3, 2, 1, 0};
  EXPECT_TRUE(CheckMethod("tessera", longer).ok());
  EXPECT_TRUE(CheckMethod("paper", semantic).ok());
  EXPECT_THAT(std::string(CheckMethod("baseline", semantic).message()), HasSubstr("semantic: found"));
}

TEST(MethodSettings, UnknownMethodListsTheMethods) {
  for (const char* method : kMethods) EXPECT_TRUE(CheckMethod(method, {}).ok()) << method;
  EXPECT_TRUE(CheckMethod("", {}).ok());
  const Status status = CheckMethod("magic", {});
  for (const char* word : {"method: found \"magic\"", "tessera", "baseline", "paper"}) {
    EXPECT_THAT(std::string(status.message()), HasSubstr(word));
  }
}

// The task's key contains the parameters, so every setting must change them.
TEST(MethodSettings, EverySettingChangesTheTaskParameters) {
  std::set<std::string> seen;
  for (const char* method : kMethods) EXPECT_TRUE(seen.insert(ToJson(RefineParameters{0, method, {}})).second);
  const auto add = [&seen](const MethodSettings& settings, const char* name) {
    const RefineParameters parameters = {0, "tessera", settings};
    EXPECT_TRUE(seen.insert(ToJson(parameters)).second) << name;
    const auto parsed = ParseRefineParameters(ToJson(parameters));
    ASSERT_TRUE(parsed.ok()) << parsed.status();
    EXPECT_EQ(parsed->settings, settings) << name;
  };
  for (const auto& setting : RealSettings()) {
    for (const double value : {setting.low, setting.high}) {
      MethodSettings settings;
      settings.*setting.value = value;
      add(settings, setting.name);
    }
  }
  for (const auto& setting : WholeSettings()) {
    for (const int value : {setting.low, setting.high}) {
      MethodSettings settings;
      settings.*setting.value = value;
      add(settings, setting.name);
    }
  }
  for (const ListSetting& setting : ListSettings()) {
    MethodSettings settings;
    settings.*setting.value = {3, 2};
    add(settings, setting.name);
  }
  for (const BoolSetting& setting : BoolSettings()) {
    for (const bool value : {false, true}) {
      MethodSettings settings;
      settings.*setting.value = value;
      add(settings, setting.name);
    }
  }
}

}  // namespace
}  // namespace tessera
