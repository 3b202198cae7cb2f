#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/settings/job_settings.h"
#include "server/settings/settings_proto.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

using testing::HasSubstr;

void ExpectRoundTrip(const JobSettings& settings) {
  v1::JobSettings message, received;
  message.mutable_method_settings()->set_partners(3);  // of an earlier use
  ToProto(settings, &message);
  ASSERT_TRUE(received.ParseFromString(message.SerializeAsString()));
  const JobSettings back = FromProto(received);
  EXPECT_EQ(back.tiles, settings.tiles);
  EXPECT_EQ(back.rounds, settings.rounds);
  EXPECT_EQ(back.method, settings.method);
  EXPECT_EQ(back.method_settings, settings.method_settings) << ToJson(back.method_settings);
}

TEST(Settings, RoundTripThroughProto) {
  ExpectRoundTrip({});
  ExpectRoundTrip({.tiles = 3, .rounds = 2, .method = "paper"});
  for (const auto& setting : RealSettings()) {
    JobSettings settings;
    for (const double value : {0.0, setting.low, 1.0 / 3, setting.high}) {
      settings.method_settings.*setting.value = value;
      ExpectRoundTrip(settings);
    }
  }
  for (const auto& setting : WholeSettings()) {
    JobSettings settings;
    for (const int value : {0, setting.low, setting.high}) {
      settings.method_settings.*setting.value = value;
      ExpectRoundTrip(settings);
    }
  }
  JobSettings lists;
  lists.method_settings.levels = {1, 0};
  lists.method_settings.iterations = {20, 5};
  lists.method_settings.labels_first = false;
  lists.method_settings.flip_edges = false;
  ExpectRoundTrip(lists);
}

TEST(Settings, SkippedImagesAndAnywayAreOfNewScenesOnly) {
  JobSettings settings;
  settings.skip_images = 0.25;
  settings.anyway = true;
  EXPECT_TRUE(CheckJobSettings(settings).ok());
  v1::JobSettings message;
  ToProto(settings, &message);
  EXPECT_EQ(FromProto(message).skip_images, 0.25);
  EXPECT_TRUE(FromProto(message).anyway);
  JobSettings update;
  update.update.base = "jobs/1";
  const StatusOr<JobSettings> completed = SettingsOfUpdate(update, settings);
  ASSERT_TRUE(completed.ok()) << completed.status();
  EXPECT_TRUE(CheckJobSettings(*completed).ok()) << "an update does not inherit them";
  settings.update.base = "jobs/1";
  EXPECT_THAT(std::string(CheckJobSettings(settings).message()), HasSubstr("they do not apply to updates"));
  JobSettings too_many;
  too_many.skip_images = 1;
  EXPECT_THAT(std::string(CheckJobSettings(too_many).message()), HasSubstr("skip images: found 1, expected"));
}

TEST(Settings, UnsetSettingsStayUnset) {
  v1::JobSettings message;
  ToProto({}, &message);
  EXPECT_FALSE(message.has_method_settings());
  EXPECT_EQ(FromProto(v1::JobSettings()).method, "tessera");
}

TEST(Settings, RollbackExcludesOtherUpdateSettings) {
  JobSettings settings;
  settings.update.base = "jobs/2";
  settings.update.rollback_tiles = {1, 4};
  EXPECT_THAT(std::string(CheckJobSettings(settings).message()), HasSubstr("tiles without an earlier job"));
  settings.update.rollback_to = "jobs/1";
  EXPECT_TRUE(CheckJobSettings(settings).ok());
  v1::JobSettings message;
  ToProto(settings, &message);
  EXPECT_EQ(FromProto(message).update, settings.update);
  settings.update.withdraw = {"spring"};
  EXPECT_FALSE(CheckJobSettings(settings).ok());
}

TEST(Settings, AllFaultsAreReportedTogether) {
  JobSettings settings = {.tiles = -1, .rounds = kMaxRounds + 1, .method = "magic"};
  settings.method_settings.window_px = 99;
  settings.method_settings.semantic = -2;
  const Status status = CheckJobSettings(settings);
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  for (const char* words : {"tiles: found -1, expected 0", "rounds: found 21, expected 0", "method: found \"magic\"",
                            "window_px: found 99, expected 3 to 11", "semantic: found -2, expected 0 to 100"}) {
    EXPECT_THAT(std::string(status.message()), HasSubstr(words));
  }
  EXPECT_TRUE(CheckJobSettings({}).ok());
}

TEST(Settings, UpdateInheritsTheClassifierKind) {
  const std::string model = "/models/city.model";
  const auto ok = [](const std::string& asked, const std::string& base) {
    const auto settings = SettingsOfUpdate({.classifier = asked}, {.classifier = base});
    EXPECT_TRUE(!settings.ok() || settings->classifier == base);
    return settings.ok();
  };
  for (const std::string& base : {std::string(), std::string("default"), model}) EXPECT_TRUE(ok("", base));
  EXPECT_TRUE(ok("none", "") && ok("default", "default") && ok("/elsewhere/same.model", model));
  EXPECT_FALSE(ok("none", model) || ok("none", "default") || ok("default", "") || ok(model, "") ||
               ok(model, "default"));
  EXPECT_FALSE(CheckJobSettings({.classifier = "city.model"}).ok()) << "which folder's?";
  EXPECT_TRUE(CheckJobSettings({.classifier = model}).ok());
}

TEST(Settings, ExportsRoundTripAndAreChecked) {
  JobSettings settings;
  settings.exports = {{"changes"}, "EPSG:32633+5773", "image", 0.25, true};
  settings.update.base = "jobs/1";
  settings.update.export_only = true;
  v1::JobSettings message;
  ToProto(settings, &message);
  EXPECT_EQ(FromProto(message).exports, settings.exports);
  EXPECT_EQ(FromProto(message).update, settings.update);
  EXPECT_TRUE(CheckJobSettings(settings).ok()) << CheckJobSettings(settings);
  EXPECT_TRUE(Differences(settings, {}).size() >= 5);

  JobSettings none = settings;
  none.exports = {};
  EXPECT_THAT(std::string(CheckJobSettings(none).message()), HasSubstr("found no formats"));
  JobSettings back = settings;
  back.update.export_only = false;
  back.update.rollback_to = "jobs/0";
  EXPECT_THAT(std::string(CheckJobSettings(back).message()), HasSubstr("found formats in a rollback"));
  JobSettings without_base;
  without_base.exports.formats = {"changes"};
  EXPECT_THAT(std::string(CheckJobSettings(without_base).message()), HasSubstr("without a base job"));
}

// Every fault is listed, in the form of the exporting functions.
TEST(Settings, HostileExportsAreRefused) {
  JobSettings settings;
  settings.exports = {{"../../etc", "<img src=x onerror=alert(1)>"}, "", std::string(100, '\n'), -1, false};
  const std::string message(CheckJobSettings(settings).message());
  EXPECT_THAT(message, HasSubstr("found '../../etc', expected some of "));
  EXPECT_THAT(message, HasSubstr("color: found '"));
  EXPECT_THAT(message, HasSubstr("gsd: found -1"));
  settings.exports.formats.clear();
  EXPECT_THAT(std::string(CheckJobSettings(settings).message()), HasSubstr("formats: found none"));
}

TEST(Settings, UpdatesDoNotInheritExports) {
  JobSettings base, asked;
  base.exports.formats = {"changes"};
  asked.update.base = "jobs/1";
  EXPECT_TRUE(SettingsOfUpdate(asked, base)->exports.formats.empty());
  asked.exports.formats = {"changes"};
  EXPECT_EQ(SettingsOfUpdate(asked, {})->exports, asked.exports);
}

}  // namespace
}  // namespace tessera
