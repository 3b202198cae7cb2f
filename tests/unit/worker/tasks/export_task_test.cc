// The stages of an export, with formats of this test.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <map>

#include "common/base/clock.h"
#include "common/job/task_kinds.h"
#include "common/job/task_parameters.h"
#include "common/meshio/ply.h"
#include "common/storage/files.h"
#include "common/storage/zip_file.h"
#include "worker/city/city_file.h"
#include "worker/tasks/export_sheets.h"
#include "worker/tasks/task_functions.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::UnorderedElementsAre;

constexpr int kCityLength = 40, kCityWidth = 4;  // squares of 1 m: three sheets in a row
constexpr double kLift_m = 0.5;                  // of the result above the start

StatusOr<std::vector<std::string>> WriteTwoFiles(const SheetInput& input, const std::string& folder,
                                                 const TaskControl&) {
  const std::string name = SheetName(input.id);
  TESSERA_RETURN_IF_ERROR(EnsureFolder(folder + "/nodes"));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(folder + "/nodes/" + name + ".node", name));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(folder + "/" + name + ".txt", input.set_aside ? "set aside" : "good"));
  TESSERA_RETURN_IF_ERROR(
      WriteFileAtomic(folder + "/" + kPartFile, std::to_string(input.sheet.faces.size()) + " " +
                                                    std::to_string(input.neighbours.size()) + " " +
                                                    std::to_string(input.start ? input.start->faces.size() : 0)));
  return std::vector<std::string>{"nodes/" + name + ".node", name + ".txt"};
}

StatusOr<std::vector<std::string>> WriteOneFile(const SheetInput& input, const std::string& folder,
                                                const TaskControl&) {
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(folder + "/" + SheetName(input.id), "one"));
  return std::vector<std::string>{SheetName(input.id)};
}

StatusOr<std::vector<std::string>> WriteOutside(const SheetInput&, const std::string& folder, const TaskControl&) {
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(folder + "/../evil", "evil"));
  return std::vector<std::string>{"../evil"};
}

StatusOr<std::vector<std::string>> JoinNames(const JoinInput& input, const std::string& folder, const TaskControl&) {
  std::string text;
  for (const JoinInput::Item& item : input.sheets) {
    TESSERA_ASSIGN_OR_RETURN(const std::string part, ReadFile(item.part_path));
    text += SheetName(item.id) + ": " + part + (item.set_aside ? " set aside" : "") + "\n";
  }
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(folder + "/all.txt", text));
  return std::vector<std::string>{"all.txt"};
}

ExportFormat TwoFiles() {
  ExportFormat format;
  format.name = "two";
  format.has_part = format.reads_neighbours = format.reads_start = true;
  format.write_sheet = WriteTwoFiles;
  format.join = JoinNames;
  return format;
}

class ExportTaskTest : public testing::Test {
 protected:
  ExportTaskTest() : folder_(TempFolder::Create(testing::TempDir()).value()) {
    for (int y = 0; y <= kCityWidth; ++y) {
      for (int x = 0; x <= kCityLength; ++x) start_.vertices.emplace_back(x, y, 0);
    }
    const auto at = [](int x, int y) { return static_cast<uint32_t>(y * (kCityLength + 1) + x); };
    for (int y = 0; y < kCityWidth; ++y) {
      for (int x = 0; x < kCityLength; ++x) {
        start_.faces.push_back({at(x, y), at(x + 1, y), at(x, y + 1)});
        start_.faces.push_back({at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)});
      }
    }
    start_.labels.assign(start_.faces.size(), 0);
    result_ = start_;
    for (Eigen::Vector3d& vertex : result_.vertices) vertex.z() += kLift_m;
    result_.labels.back() = 1;
    scene_.gsd_m = 0.1;
    scene_.ground = MakeGroundPlane(scene_.up, 1);
    scene_.classes.resize(2);
    scene_.classes[0].name = "ground";
    scene_.classes[1].name = "<img src=x>";
    for (const char* name : {"/city", "/split"}) EXPECT_TRUE(EnsureFolder(folder_.path() + name).ok());
  }

  void WriteInputs() {
    CitySpans city;
    city.mesh = start_;
    const Status written = WriteCity(Path(std::string("city/") + kCityFile), city, scene_.ground,
                                     CellsOf(city.mesh, scene_.ground), folder_.path(), /*max_block_faces=*/50);
    ASSERT_TRUE(written.ok()) << written;
    PlyWriteOptions options;
    options.face_confidence.assign(result_.faces.size(), 0.25f);
    ASSERT_TRUE(WritePly(Path(std::string("city/") + kMeshFile), result_, options).ok());
  }
  std::string Path(const std::string& name) const { return folder_.path() + "/" + name; }
  // Sheets 0 to 2 have faces; the last one has none.
  ExportParameters SplitParameters() const {
    ExportParameters parameters;
    parameters.scene = ExportSceneToJson(scene_);
    parameters.sheets = {{0, 0}, {1, 0}, {2, 0}, {7, 0}};
    parameters.start = true;
    return parameters;
  }
  StatusOr<TaskOutcome> Split() {
    const TaskRequest request = {kExportKind, ToJson(SplitParameters()), Path("city"), Path("split")};
    return RunExport(request, {}, SystemClock());
  }
  // Runs the stage on the outputs of split and of earlier stages.
  StatusOr<TaskOutcome> RunSheet(const ExportFormat& format, const SheetId& id, std::vector<SheetId> neighbours,
                                 bool set_aside = false) {
    ExportOptions options;
    options.formats = {std::string(format.name)};
    parameters_.stage = ExportStage::kSheet;
    parameters_.format = format.name;
    parameters_.options = ExportOptionsToJson(options);
    parameters_.sheet = id;
    parameters_.sheets = std::move(neighbours);
    parameters_.start = format.reads_start;
    if (set_aside) parameters_.set_aside = {id};
    return ExportSheet({kExportKind, "", Path("split"), Path("split")}, parameters_, format, {});
  }

  TempFolder folder_;
  TriangleMesh start_, result_;
  ExportScene scene_;
  ExportParameters parameters_;
};

TEST_F(ExportTaskTest, SplitWritesEverySheetOfTheSurvey) {
  ASSERT_NO_FATAL_FAILURE(WriteInputs());
  const auto outcome = Split();
  ASSERT_TRUE(outcome.ok()) << outcome.status();
  EXPECT_THAT(outcome->outputs,
              UnorderedElementsAre(kExportSceneFile, kSheetListFile, "sheets/0_0.arrays", "sheets/1_0.arrays",
                                   "sheets/2_0.arrays", "sheets/7_0.arrays", "start/0_0.arrays", "start/1_0.arrays",
                                   "start/2_0.arrays", "start/7_0.arrays"));
  EXPECT_THAT(*ParseSheetList(*ReadFile(Path(std::string("split/") + kSheetListFile))),
              ElementsAre(SheetId{0, 0}, SheetId{1, 0}, SheetId{2, 0}));
  EXPECT_EQ(*ReadFile(Path(std::string("split/") + kExportSceneFile)), ExportSceneToJson(scene_));
  size_t faces = 0, start_faces = 0;
  for (const SheetId& id : SplitParameters().sheets) {
    const auto sheet = ReadSheet(Path("split/" + SheetFileName(id))),
               start = ReadSheet(Path("split/" + StartSheetFileName(id)));
    ASSERT_TRUE(sheet.ok() && start.ok()) << sheet.status() << start.status();
    faces += sheet->faces.size();
    start_faces += start->faces.size();
    ASSERT_EQ(sheet->displacement_m.size(), sheet->vertices.size());
    for (const float displacement_m : sheet->displacement_m) EXPECT_EQ(displacement_m, static_cast<float>(kLift_m));
    for (const float confidence : sheet->confidence) EXPECT_EQ(confidence, 0.25f);
    for (const Eigen::Vector3d& vertex : sheet->vertices) EXPECT_EQ(vertex.z(), kLift_m);
    for (const Eigen::Vector3d& vertex : start->vertices) EXPECT_EQ(vertex.z(), 0);
  }
  EXPECT_EQ(faces, result_.faces.size());
  EXPECT_EQ(start_faces, start_.faces.size());
  const auto last = ReadSheet(Path("split/" + SheetFileName({2, 0})));
  EXPECT_TRUE(std::count(last->labels.begin(), last->labels.end(), 1) == 1);
}

TEST_F(ExportTaskTest, AMeshOfAnotherCityIsRefused) {
  result_.vertices.emplace_back(1, 1, 1);
  ASSERT_NO_FATAL_FAILURE(WriteInputs());
  EXPECT_EQ(Split().status().code(), absl::StatusCode::kDataLoss);
  result_.vertices.pop_back();
  result_.labels[0] = 2;
  ASSERT_NO_FATAL_FAILURE(WriteInputs());
  EXPECT_EQ(Split().status().code(), absl::StatusCode::kDataLoss) << "no such class";
}

TEST_F(ExportTaskTest, SeveralFilesAreOneArchiveAndPartsAreForJoin) {
  ASSERT_NO_FATAL_FAILURE(WriteInputs());
  ASSERT_TRUE(Split().ok());
  const ExportFormat format = TwoFiles();
  const auto first = RunSheet(format, {0, 0}, {{1, 0}}), second = RunSheet(format, {1, 0}, {{0, 0}, {2, 0}}),
             last = RunSheet(format, {2, 0}, {{1, 0}}, /*set_aside=*/true), empty = RunSheet(format, {7, 0}, {});
  for (const auto* each : {&first, &second, &last, &empty}) ASSERT_TRUE(each->ok()) << each->status();
  EXPECT_THAT(first->outputs, ElementsAre("export/two/0_0.zip", "parts/two/0_0.arrays"));
  EXPECT_THAT(empty->outputs, ElementsAre("parts/two/7_0.arrays")) << "nothing is delivered";
  auto zip = ZipFile::Open(Path("split/export/two/2_0.zip"));
  ASSERT_TRUE(zip.ok()) << zip.status();
  EXPECT_THAT(zip->members(), ElementsAre("2_0.txt", "nodes/2_0.node"));
  EXPECT_EQ(*zip->Read("2_0.txt", 100), "set aside");
  EXPECT_FALSE(fs::exists(Path("split/export/two/2_0.txt")));

  ExportParameters join = parameters_;
  join.stage = ExportStage::kJoin;
  join.sheets = SplitParameters().sheets;
  join.set_aside = {{2, 0}};
  const auto joined = JoinExport({kExportKind, "", Path("split"), Path("split")}, join, format, {});
  ASSERT_TRUE(joined.ok()) << joined.status();
  EXPECT_THAT(joined->outputs, ElementsAre("export/two/all.txt"));
  EXPECT_EQ(*ReadFile(Path("split/export/two/all.txt")), "0_0: 128 1 128\n1_0: 128 2 128\n2_0: 64 1 64 set aside\n");
}

TEST_F(ExportTaskTest, OneFileIsDeliveredAsItIs) {
  ASSERT_NO_FATAL_FAILURE(WriteInputs());
  ASSERT_TRUE(Split().ok());
  ExportFormat format;
  format.name = "one";
  format.write_sheet = WriteOneFile;
  EXPECT_THAT(RunSheet(format, {1, 0}, {})->outputs, ElementsAre("export/one/1_0"));
  EXPECT_EQ(*ReadFile(Path("split/export/one/1_0")), "one");
  format.write_sheet = WriteOutside;
  EXPECT_EQ(RunSheet(format, {1, 0}, {}).status().code(), absl::StatusCode::kInvalidArgument);
}

StatusOr<std::vector<std::string>> JoinWithAWarning(const JoinInput& input, const std::string&, const TaskControl&) {
  input.warnings->push_back("simplified");
  return std::vector<std::string>();
}

TEST_F(ExportTaskTest, WarningsOfAFormatAreThoseOfItsTask) {
  ASSERT_NO_FATAL_FAILURE(WriteInputs());
  ASSERT_TRUE(Split().ok());
  ExportFormat format;
  format.name = "told";
  format.join = JoinWithAWarning;
  ExportOptions options;
  options.formats = {"told"};
  ExportParameters join;
  join.stage = ExportStage::kJoin;
  join.options = ExportOptionsToJson(options);
  const auto joined = JoinExport({kExportKind, "", Path("split"), Path("split")}, join, format, {});
  ASSERT_TRUE(joined.ok()) << joined.status();
  EXPECT_THAT(joined->warnings, ElementsAre("simplified"));
  // An update without a change report has nothing to write.
  format.name = "changes";
  format.reads_changes = true;
  const auto without = JoinExport({kExportKind, "", Path("split"), Path("split")}, join, format, {});
  ASSERT_TRUE(without.ok()) << without.status();
  EXPECT_THAT(without->warnings, ElementsAre(testing::HasSubstr("changes: the job has no changes.geojson")));
  EXPECT_TRUE(without->outputs.empty());
}

TEST_F(ExportTaskTest, UnknownFormatsAndParametersAreRefused) {
  for (const std::string& parameters :
       {std::string("{}"), std::string(R"({"format":"none","options":"","sheet":[0,0],"stage":"sheet"})"),
        std::string(R"({"format":"none","stage":"join"})"), std::string(R"({"stage":"split"})")}) {
    const auto outcome = RunExport({kExportKind, parameters, Path("city"), Path("split")}, {}, SystemClock());
    EXPECT_EQ(outcome.status().code(), absl::StatusCode::kInvalidArgument) << parameters << outcome.status();
  }
}

}  // namespace
}  // namespace tessera
