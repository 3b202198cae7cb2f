// Each kind of wrong input gives its message and exit code 3, and leaves no partial files.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <ostream>
#include <sstream>
#include <string>
#include <vector>

#include "tests/e2e/programs.h"

namespace tessera::e2e {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

struct BadInput {
  std::string name;
  std::function<void(const std::string& city)> spoil;
  std::vector<std::string> messages;  // all of them are told
};

// Names the test's parameter in lists of tests.
void PrintTo(const BadInput& input, std::ostream* out) { *out << input.name; }

void WriteText(const std::string& path, const std::string& content) {
  ASSERT_TRUE(WriteFileAtomic(path, content).ok());
}

void Replace(const std::string& path, const std::string& from, const std::string& to) {
  std::string content = Content(path);
  const size_t at = content.find(from);
  ASSERT_NE(at, std::string::npos) << path << " has no " << from;
  WriteText(path, content.replace(at, from.size(), to));
}

std::string FirstIn(const std::string& folder) { return folder + "/" + ListFiles(folder).value().front(); }

std::vector<BadInput> BadInputs() {
  return {
      {"NoScene", [](const std::string& city) { fs::remove_all(city); }, {"city"}},
      {"NoSceneJson", [](const std::string& city) { fs::remove(city + "/scene.json"); }, {"scene.json"}},
      {"UnreadableJson",
       [](const std::string& city) { WriteText(city + "/scene.json", "{\n \"tessera_scene\": 1,\n oops\n}"); },
       {"scene.json", "line 3"}},
      {"MissingImage", [](const std::string& city) { fs::remove(FirstIn(city + "/images")); }, {"east_00_000.jpg"}},
      {"MissingImages",
       [](const std::string& city) {
         fs::remove(city + "/images/east_00_000.jpg");
         fs::remove(city + "/images/nadir_00_001.jpg");
       },
       {"east_00_000.jpg", "nadir_00_001.jpg"}},
      {"UnreadableImage",
       [](const std::string& city) { WriteText(city + "/images/east_00_000.jpg", "not a picture"); },
       {"east_00_000.jpg"}},
      {"ImageDamagedInside",
       [](const std::string& city) {
         std::string jpeg = Content(city + "/images/east_00_000.jpg");
         std::fill(jpeg.begin() + jpeg.size() * 4 / 10, jpeg.begin() + jpeg.size() * 6 / 10, '\0');
         WriteText(city + "/images/east_00_000.jpg", jpeg);
       },
       {"east_00_000.jpg", "a damaged JPEG image"}},
      {"TruncatedMesh",
       [](const std::string& city) { fs::resize_file(city + "/mesh.ply", fs::file_size(city + "/mesh.ply") / 2); },
       {"mesh.ply"}},
      {"UnknownCameraModel",
       [](const std::string& city) { Replace(city + "/colmap/cameras.txt", "PINHOLE", "FISHBALL"); },
       {"cameras.txt", "FISHBALL"}},
      {"MissingClass",
       [](const std::string& city) {
         Replace(city + "/scene.json", "\"vegetation\"", "\"vegetation\", {\"name\": \"water\"}");
       },
       {"likelihoods"}},
      {"TruncatedLikelihood",
       [](const std::string& city) { fs::resize_file(FirstIn(city + "/likelihoods"), 100); },
       {"east_00_000"}},
  };
}

class BadInputTest : public testing::TestWithParam<BadInput> {};

TEST_P(BadInputTest, ReportsFaultWithExitCodeAndLeavesNoFiles) {
  const TempFolder folder = TempFolder::Create(testing::TempDir()).value();
  const std::string city = folder.path() + "/city";
  fs::copy(ToyCity(), city, fs::copy_options::recursive);
  GetParam().spoil(city);
  const std::string out = folder.path() + "/out";
  const Outcome outcome = Tessera(folder.path(), {"run", city, "--out", out, "--tiles", "4"});
  EXPECT_EQ(outcome.exit_code, 3) << outcome.output;
  for (const std::string& message : GetParam().messages) EXPECT_THAT(outcome.output, HasSubstr(message));
  EXPECT_FALSE(fs::exists(out + "/mesh.ply"));
  EXPECT_FALSE(fs::exists(out + "/report.json"));
}

INSTANTIATE_TEST_SUITE_P(Kinds, BadInputTest, testing::ValuesIn(BadInputs()),
                         [](const testing::TestParamInfo<BadInput>& kind) { return kind.param.name; });

TEST(BadInputLeftoversTest, RefusedSceneKeepsFolderState) {
  const TempFolder folder = TempFolder::Create(testing::TempDir()).value();
  const std::string city = folder.path() + "/city";
  ASSERT_TRUE(EnsureFolder(city).ok());
  WriteText(city + "/scene.json", "{");
  const std::string out = folder.path() + "/out";
  EXPECT_EQ(Tessera(folder.path(), {"run", city, "--out", out}).exit_code, 3);
  EXPECT_FALSE(fs::exists(out));
  ASSERT_TRUE(EnsureFolder(out).ok());
  WriteText(out + "/mesh.ply", "of an earlier run");
  EXPECT_EQ(Tessera(folder.path(), {"run", city, "--out", out}).exit_code, 3);
  EXPECT_EQ(Content(out + "/mesh.ply"), "of an earlier run");
}

class SpoiltCityTest : public testing::Test {
 protected:
  SpoiltCityTest() { fs::copy(ToyCity(), city_, fs::copy_options::recursive); }
  Outcome Run(const std::vector<std::string>& arguments) { return Tessera(folder_.path(), arguments); }
  // Leaves the first `kept` images in the model, without image points.
  void KeepImages(int kept) {
    std::istringstream in(Content(city_ + "/colmap/images.txt"));
    std::string text;
    for (std::string line, points; std::getline(in, line);) {
      if (line.empty() || line[0] == '#') continue;
      std::getline(in, points);
      if (kept-- > 0) text += line + "\n\n";
    }
    WriteText(city_ + "/colmap/images.txt", text);
    fs::remove(city_ + "/colmap/points3D.txt");
  }

  const TempFolder folder_ = TempFolder::Create(testing::TempDir()).value();
  const std::string city_ = folder_.path() + "/city", out_ = folder_.path() + "/out";
};

TEST_F(SpoiltCityTest, MissingAndBrokenImagesAreLeftOutOnRequest) {
  fs::remove(city_ + "/images/east_00_000.jpg");
  const std::string broken = city_ + "/images/nadir_00_001.jpg";
  fs::resize_file(broken, fs::file_size(broken) / 2);
  const Outcome refused = Run({"check", city_});
  EXPECT_EQ(refused.exit_code, 3) << refused.output;
  EXPECT_THAT(refused.output, HasSubstr("to leave out the 2 missing or broken images: --skip-images 0."));
  const Outcome checked = Run({"check", city_, "--skip-images", "0.5"});
  EXPECT_EQ(checked.exit_code, 0) << checked.output;
  const Outcome run = Run({"run", city_, "--out", out_, "--tiles", "1", "--rounds", "1", "--skip-images", "0.5"});
  ASSERT_EQ(run.exit_code, 0) << run.output;
  const auto skipped = nlohmann::json::parse(Content(out_ + "/report.json"))["skipped_images"];
  ASSERT_EQ(skipped.size(), 2u) << skipped;
  EXPECT_EQ(skipped[0]["name"], "east_00_000.jpg");
  EXPECT_EQ(skipped[0]["reason"], "no such file");
  EXPECT_EQ(skipped[1]["name"], "nadir_00_001.jpg");
  for (const Outcome& outcome : {checked, run}) {
    EXPECT_THAT(outcome.output, HasSubstr("images are left out: east_00_000.jpg (no such file)"));
    EXPECT_THAT(outcome.output, HasSubstr("images are left out: nadir_00_001.jpg ("));
  }
}

TEST_F(SpoiltCityTest, OneImageIsRefusedByCheckAndRunAlike) {
  KeepImages(1);
  for (const std::vector<std::string>& command :
       {std::vector<std::string>{"check", city_}, std::vector<std::string>{"run", city_, "--out", out_}}) {
    const Outcome outcome = Run(command);
    EXPECT_EQ(outcome.exit_code, 3) << outcome.output;
    EXPECT_THAT(outcome.output, HasSubstr("found 1 image, expected at least 2 images of the same surface"));
  }
}

TEST_F(SpoiltCityTest, AnErrorComesBeforeWarningsAndNamesNoFolderOfAWorker) {
  Replace(city_ + "/scene.json", "\"mesh\"", "\"likelihoods_source\": \"default\", \"mesh\"");
  fs::resize_file(city_ + "/mesh.ply", fs::file_size(city_ + "/mesh.ply") / 2);
  for (const std::vector<std::string>& command :
       {std::vector<std::string>{"check", city_}, std::vector<std::string>{"run", city_, "--out", out_}}) {
    const std::string output = Run(command).output;
    const size_t error = output.find("mesh.ply: "), warning = output.find("warning: likelihoods come from the default");
    ASSERT_NE(error, std::string::npos) << output;
    ASSERT_NE(warning, std::string::npos) << output;
    EXPECT_LT(error, warning) << output;
    EXPECT_EQ(output.find("/tasks/task-"), std::string::npos) << output;
  }
}

TEST_F(SpoiltCityTest, JsonOfARefusedSceneHasItsErrors) {
  fs::remove(city_ + "/mesh.ply");
  EXPECT_EQ(Run({"check", city_, "--json", out_ + ".json"}).exit_code, 3);
  const auto json = nlohmann::json::parse(Content(out_ + ".json"));
  EXPECT_THAT(json["errors"].dump(), HasSubstr("mesh.ply: found no such file"));
  EXPECT_TRUE(json["warnings"].is_array());
}

TEST(BadSettingsTest, InvalidSettingsAreRefusedBeforeAnyTask) {
  const TempFolder folder = TempFolder::Create(testing::TempDir()).value();
  const std::string out = folder.path() + "/out";
  const Outcome run = Tessera(folder.path(), {"run", ToyCity(), "--out", out, "--method", "magic", "--window-px", "12",
                                              "--thin-plate", "-1", "--rounds", "99"});
  EXPECT_EQ(run.exit_code, 2) << run.output;
  for (const char* words :
       {"method: found \"magic\", expected tessera, baseline, paper", "window_px: found 12, expected 3 to 11",
        "thin_plate: found -1, expected 0 to 100", "rounds: found 99, expected 0"}) {
    EXPECT_THAT(run.output, HasSubstr(words));
  }
  EXPECT_FALSE(fs::exists(out));
  // No coordinator is asked either.
  const Outcome submit = Tessera(folder.path(), {"submit", ToyCity(), "--coordinator", "127.0.0.1:1", "--levels", "1"});
  EXPECT_EQ(submit.exit_code, 2) << submit.output;
  EXPECT_THAT(submit.output, HasSubstr("iterations: found 3 numbers (4,8,6), expected one for each of the 1 levels"));
}

}  // namespace
}  // namespace tessera::e2e
