// `tessera export`: results become files of other programs, or are refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "common/exporting/export_format.h"
#include "common/storage/hash.h"
#include "tests/e2e/programs.h"

namespace tessera::e2e {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

class ExportTest : public testing::Test {
 protected:
  ExportTest()
      : folder_(TempFolder::Create(testing::TempDir()).value()),
        result_(UndisturbedResult(ToyCity(), {"--tiles", "4"})),
        out_(folder_.path() + "/out") {}

  Outcome Export(const std::string& result, const std::string& formats,
                 const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments = {"export", result, "--to", formats, "--out", out_};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return Tessera(folder_.path(), arguments);
  }
  // The formats that every result with a scene has.
  static std::vector<std::string> Formats() {
    std::vector<std::string> names;
    for (const ExportFormat& format : ExportFormats()) {
      if (!format.reads_changes) names.emplace_back(format.name);
    }
    return names;
  }
  // Content of all files by name.
  std::map<std::string, std::string> Files(const std::string& folder) const {
    std::map<std::string, std::string> files;
    const StatusOr<std::vector<std::string>> names = ListFiles(folder);
    for (const std::string& name : *names) files[name] = Content(folder + "/" + name);
    return files;
  }
  // export.json lists the other files with their hashes.
  nlohmann::json CheckedIndex() const {
    auto index = nlohmann::json::parse(Content(out_ + "/export.json"));
    EXPECT_EQ(index["files"].size() + 1, ListFiles(out_)->size());
    for (const nlohmann::json& file : index["files"]) {
      EXPECT_EQ(file["sha256"], HashFile(out_ + "/" + file["file"].get<std::string>())->sha256);
    }
    return index;
  }

  const TempFolder folder_;
  const std::string result_, out_;
};

TEST_F(ExportTest, EveryFormatWritesTheSameFilesAgain) {
  for (const std::string& format : Formats()) {
    const Outcome outcome = Export(result_, format, {"--scene", ToyCity()});
    ASSERT_EQ(outcome.exit_code, 0) << format << ": " << outcome.output;
    EXPECT_THAT(outcome.output, HasSubstr(out_ + "/" + format));
    const nlohmann::json index = CheckedIndex();
    EXPECT_EQ(index["formats"], nlohmann::json{format});
    EXPECT_GE(index["files"].size(), 1u) << format;
    for (const nlohmann::json& file : index["files"]) {
      EXPECT_THAT(file["file"].get<std::string>(), testing::StartsWith(format + "/"));
    }
    const auto files = Files(out_);
    fs::remove_all(out_);
    ASSERT_EQ(Export(result_, format, {"--scene", ToyCity(), "--quiet"}).exit_code, 0);
    EXPECT_EQ(Files(out_), files) << format;
    fs::remove_all(out_);
  }
}

TEST_F(ExportTest, VerticesHaveTheColorsAskedFor) {
  for (const ExportFormat& format : ExportFormats()) {
    if (!format.colored) continue;
    const std::string name(format.name);
    std::map<std::string, std::string> color_of;  // files of each colour, as their list in export.json
    for (const std::string color : {"class", "image", "confidence", "displacement"}) {
      const Outcome outcome = Export(result_, name, {"--scene", ToyCity(), "--color", color});
      ASSERT_EQ(outcome.exit_code, 0) << name << ": " << outcome.output;
      const std::string files = CheckedIndex()["files"].dump();
      EXPECT_TRUE(color_of.emplace(files, color).second) << name << ": " << color << " is as " << color_of[files];
      fs::remove_all(out_);
    }
  }
}

// gltf-validator, geotiff.js, and the schema of 3D Tiles.
TEST_F(ExportTest, OtherProgramsReadTheFiles) {
  if (!fs::exists(TESSERA_VALIDATORS "/node_modules")) {
    GTEST_SKIP() << "tests/validators/install " TESSERA_VALIDATORS " has not installed the validators";
  }
  const Outcome exported = Export(result_, "3dtiles,classes,dsm,glb,ortho", {"--scene", ToyCity()});
  ASSERT_EQ(exported.exit_code, 0) << exported.output;
  const Outcome outcome =
      Program(folder_.path(), "/usr/bin/env", {"node", TESSERA_VALIDATORS "/validate.mjs", out_}).Wait();
  EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_THAT(outcome.output, HasSubstr(": 0 faults"));
}

// Assimp is a reader of its own: it finds all faces, at the same place.
TEST_F(ExportTest, AssimpReadsTheMeshes) {
  const Outcome exported = Export(result_, "glb,obj,ply", {"--scene", ToyCity(), "--quiet"});
  ASSERT_EQ(exported.exit_code, 0) << exported.output;
  const std::string mesh = Content(result_ + "/mesh.ply"), element = "element face ";
  const std::string faces = mesh.substr(mesh.find(element) + element.size(), 20);
  std::vector<std::string> corners;
  for (const std::string file : {"obj/mesh.obj", "ply/mesh.ply", "glb/mesh.glb"}) {
    const Outcome read = Program(folder_.path(), "/usr/bin/env", {"assimp", "info", out_ + "/" + file}).Wait();
    EXPECT_EQ(read.exit_code, 0) << file << ": " << read.output;
    const auto after = [&read](const std::string& label) {
      const size_t start = read.output.find(label);
      return start == std::string::npos ? "" : read.output.substr(start, read.output.find('\n', start) - start);
    };
    EXPECT_EQ(after("Faces:"), absl::StrCat("Faces:              ", std::atoi(faces.c_str()))) << file;
    corners.push_back(after("Minimum point") + after("Maximum point"));
  }
  EXPECT_EQ(corners[0], corners[1]);
  EXPECT_THAT(corners[0], HasSubstr("("));
  EXPECT_NE(corners[2], corners[0]) << "glTF has another axis up";
}

TEST_F(ExportTest, ChangesOfAnUpdateAreExported) {
  const std::string base = UndisturbedResult(Street(), {"--tiles", "8"});
  const std::string update = UndisturbedResult(NextFlight(), {}, base);
  const Outcome outcome = Export(update, "changes");
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_EQ(Content(out_ + "/changes/changes.geojson"), Content(update + "/changes.geojson"));
  CheckedIndex();
  fs::remove_all(out_);
  EXPECT_THAT(Export(base, "changes").output, HasSubstr("no file changes.geojson, expected the result of an update"));
}

TEST_F(ExportTest, BadInputIsRefusedBeforeWork) {
  const auto refused = [&](const Outcome& outcome, int exit_code, const testing::Matcher<std::string>& output) {
    EXPECT_EQ(outcome.exit_code, exit_code) << outcome.output;
    EXPECT_THAT(outcome.output, output);
    EXPECT_FALSE(fs::exists(out_));
  };
  refused(Export(result_, "3dtilez"), 3,
          AllOf(HasSubstr("formats: found '3dtilez', expected some of"), HasSubstr("changes")));
  refused(Export(result_, "changes,3dtilez", {"--crs", "EPSG:999999"}), 3,
          AllOf(HasSubstr("3dtilez"), HasSubstr("999999"), HasSubstr("changes.geojson")));
  refused(Export(ToyCity(), "changes"), 3, HasSubstr("frame: found no such file"));
  refused(Export(folder_.path(), "changes"), 3, HasSubstr("no file mesh.ply"));
  refused(Export("jobs/1", "changes", {"--scene", ToyCity()}), 3, HasSubstr("--scene: found"));
  refused(Export(result_, "changes", {"--color", "purple"}), 2, HasSubstr("purple"));
  refused(Tessera(folder_.path(), {"export", result_, "--out", out_}), 2, HasSubstr("--to"));
}

TEST_F(ExportTest, OtherFilesAreKept) {
  if (Formats().empty()) GTEST_SKIP() << "no format";
  fs::create_directories(out_);
  fs::copy_file(result_ + "/report.json", out_ + "/mine");
  const Outcome outcome = Export(result_, Formats().front(), {"--scene", ToyCity()});
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_THAT(outcome.output, HasSubstr("found a folder with files"));
  EXPECT_EQ(ListFiles(out_)->size(), 1u);
}

TEST_F(ExportTest, AKilledExportLeavesNoFileAndIsReplaced) {
  if (Formats().empty()) GTEST_SKIP() << "no format";
  const std::string format = Formats().front();
  Program program(folder_.path(), TESSERA_PROGRAM,
                  {"export", result_, "--to", format, "--out", out_, "--scene", ToyCity()});
  ASSERT_TRUE(WaitUntil([&] { return fs::exists(out_ + "/.export/work") || !program.Running(); }));
  program.Kill();
  for (const auto& entry : fs::directory_iterator(out_)) {
    const std::string name = entry.path().filename().string();
    EXPECT_TRUE(name == ".export" || name == format || name == "export.json") << name;
  }
  if (fs::exists(out_ + "/export.json")) GTEST_SKIP() << "it was faster than the signal";
  const Outcome outcome = Export(result_, format, {"--scene", ToyCity()});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  CheckedIndex();
  EXPECT_FALSE(fs::exists(out_ + "/.export"));
}

}  // namespace
}  // namespace tessera::e2e
