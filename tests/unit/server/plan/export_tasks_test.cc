#include "server/plan/export_tasks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <map>
#include <set>

#include "absl/strings/str_cat.h"
#include "common/exporting/export_parameters.h"
#include "common/exporting/survey_sheets.h"
#include "server/plan/graph.h"
#include "tests/unit/server/plan/update_pair.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

StatusOr<std::vector<std::string>> WriteNothing(const SheetInput&, const std::string&, const TaskControl&) {
  return std::vector<std::string>();
}
StatusOr<std::vector<std::string>> JoinNothing(const JoinInput&, const std::string&, const TaskControl&) {
  return std::vector<std::string>();
}

// Formats that ask for everything, for little, and for the whole.
std::vector<ExportFormat> FakeFormats() {
  ExportFormat all;
  all.name = "all";
  all.reads_neighbours = all.reads_start = all.reads_photographs = all.colored = all.has_part = true;
  all.write_sheet = WriteNothing;
  all.join = JoinNothing;
  ExportFormat plain;
  plain.name = "plain";
  plain.write_sheet = WriteNothing;
  ExportFormat whole;
  whole.name = "whole";
  whole.join_reads_sheets = whole.reads_changes = true;
  whole.join = JoinNothing;
  return {all, plain, whole};
}

struct Planned {
  Survey survey;
  ExportOptions options;
  std::vector<std::vector<PlannedTask::ViewFile>> files;
  std::vector<PlannedTask> tasks;  // from first_task on

  explicit Planned(const Survey& of, VertexColor color = VertexColor::kClass,
                   const std::vector<CellRect>& quarantined = {}, bool changes = true)
      : survey(of) {
    options.formats = {"all", "plain", "whole"};
    options.color = color;
    files = *FilesOfViews(survey, FilesOf(survey));
    ExportWork work = {options, FakeFormats(), survey, files, TaskId(0), TaskId(1), TaskId(2), kFirst, quarantined};
    if (changes) work.changes = PlannedInput{TaskId(3), kChangesGeoJsonFile};
    auto planned = PlanExports(work);
    EXPECT_TRUE(planned.ok()) << planned.status();
    if (planned.ok()) tasks = *std::move(planned);
  }
  const PlannedTask& Named(const std::string& name) const {
    const auto found = std::find_if(tasks.begin(), tasks.end(), [&](const auto& task) { return task.name == name; });
    EXPECT_NE(found, tasks.end()) << name;
    return *found;
  }
  static ExportParameters ParametersOf(const PlannedTask& task) { return *ParseExportParameters(task.parameters); }
  static std::vector<std::string> InputsOf(const PlannedTask& task) {
    std::vector<std::string> names;
    for (const PlannedInput& input : task.inputs) names.push_back(InputName(input));
    return names;
  }
  static constexpr size_t kFirst = 4;
};

// The outputs of a task, as the worker names them.
std::set<std::string> OutputsOf(const PlannedTask& task, const std::vector<ExportFormat>& formats) {
  const ExportParameters p = *ParseExportParameters(task.parameters);
  std::set<std::string> outputs;
  if (p.stage == ExportStage::kColor) outputs.insert(ColoredSheetFileName(p.sheet));
  if (p.stage == ExportStage::kSheet) {
    const auto format = std::find_if(formats.begin(), formats.end(), [&](const auto& f) { return f.name == p.format; });
    if (format->has_part) outputs.insert(PartFileName(p.format, p.sheet));
  }
  if (p.stage != ExportStage::kSplit) return outputs;
  outputs = {kExportSceneFile, kSheetListFile};
  for (const SheetId& id : p.sheets) {
    outputs.insert(SheetFileName(id));
    if (p.start) outputs.insert(StartSheetFileName(id));
    if (p.views) outputs.insert(SheetViewsFileName(id));
  }
  return outputs;
}

TEST(ExportTasksTest, EveryInputIsAnOutputOfAnEarlierTask) {
  for (uint64_t seed = 0; seed < 10; ++seed) {
    const Survey survey = RandomSurvey(40, 50, 0.3, seed);
    for (const VertexColor color : {VertexColor::kClass, VertexColor::kImage}) {
      const Planned planned(survey, color);
      std::set<std::string> names;
      for (size_t t = 0; t < planned.tasks.size(); ++t) {
        const PlannedTask& task = planned.tasks[t];
        EXPECT_EQ(task.kind, kExportKind);
        EXPECT_EQ(task.tile, -1) << "exports are no steps of tiles";
        EXPECT_TRUE(names.insert(task.name).second) << task.name;
        EXPECT_GT(task.cost, 0);
        EXPECT_GT(task.peak_bytes, 0);
        std::set<std::string> inputs;
        for (const PlannedInput& input : task.inputs) {
          EXPECT_TRUE(inputs.insert(InputName(input)).second) << task.name << ": " << InputName(input) << " twice";
          ASSERT_LT(input.task.value(), static_cast<int>(Planned::kFirst + t));
          if (input.task.value() < static_cast<int>(Planned::kFirst)) continue;
          const PlannedTask& producer = planned.tasks[input.task.value() - Planned::kFirst];
          EXPECT_TRUE(OutputsOf(producer, FakeFormats()).contains(input.output.str()))
              << task.name << " reads " << input.output.str() << " of " << producer.name;
        }
      }
    }
  }
}

TEST(ExportTasksTest, StagesReadWhatTheirFormatAsksFor) {
  Survey survey = SeenFromAbove(40);  // cells from -5, -3: sheets -1 to 2
  const Planned planned(survey, VertexColor::kImage);
  EXPECT_THAT(Planned::InputsOf(planned.Named("export split")), ElementsAre(kMeshFile, kCityFile, kPlainSurveyFile));
  EXPECT_THAT(Planned::InputsOf(planned.Named("export plain -1_-1")),
              ElementsAre(kExportSceneFile, "sheets/-1_-1.arrays"));
  EXPECT_TRUE(planned.Named("export plain -1_-1").view_files->empty());
  EXPECT_THAT(Planned::InputsOf(planned.Named("export all -1_-1")),
              ElementsAre(kExportSceneFile, "colored/-1_-1.arrays", "colored/0_-1.arrays", "colored/-1_0.arrays",
                          "colored/0_0.arrays", "start/-1_-1.arrays", "sheet-views/-1_-1.json"));
  EXPECT_THAT(Planned::InputsOf(planned.Named("export color -1_-1")),
              ElementsAre(kExportSceneFile, "sheets/-1_-1.arrays", "sheets/0_-1.arrays", "sheets/-1_0.arrays",
                          "sheets/0_0.arrays", "sheet-views/-1_-1.json"));
  for (const PlannedTask::ViewFile& file : *planned.Named("export color -1_-1").view_files) {
    EXPECT_FALSE(file.likelihoods);
  }
  EXPECT_EQ(planned.Named("export color -1_-1").view_files->size(), survey.views.size());
  const PlannedTask& join = planned.Named("export all join");
  EXPECT_EQ(join.inputs.size(), 2 + SheetsOf(survey).size());
  EXPECT_TRUE(Planned::ParametersOf(join).sheets.size() == SheetsOf(survey).size());
  EXPECT_THAT(Planned::InputsOf(planned.Named("export whole join")),
              testing::AllOf(testing::Contains("sheets/0_0.arrays"), testing::Contains(kChangesGeoJsonFile)));
  // Options of other formats are no part of a format's keys.
  EXPECT_THAT(ParseExportOptions(Planned::ParametersOf(join).options)->formats, ElementsAre("all"));
}

TEST(ExportTasksTest, WithoutChangesTheTaskReadsNone) {
  const Planned planned(SeenFromAbove(20), VertexColor::kClass, {}, /*changes=*/false);
  const PlannedTask& join = planned.Named("export whole join");
  EXPECT_FALSE(Planned::ParametersOf(join).changes);  // the task warns
  EXPECT_THAT(Planned::InputsOf(join), testing::Not(testing::Contains(kChangesGeoJsonFile)));
  EXPECT_THAT(Planned::InputsOf(planned.Named("export split")), testing::Contains(kPlainSurveyFile)) << "photographs";
}

TEST(ExportTasksTest, SheetsOfQuarantinedTilesAreSetAside) {
  // The core ends at the border of sheets 0 and 1.
  const Planned planned(SeenFromAbove(40), VertexColor::kClass, {{12, 0, 16, 5}});
  EXPECT_THAT(Planned::ParametersOf(planned.Named("export all join")).set_aside, ElementsAre(SheetId{0, 0}));
  EXPECT_THAT(Planned::ParametersOf(planned.Named("export plain 0_0")).set_aside, ElementsAre(SheetId{0, 0}));
  EXPECT_THAT(Planned::ParametersOf(planned.Named("export plain 1_0")).set_aside, IsEmpty());
}

// The keys of all tasks, if every output of split has the content that `content` gives.
std::map<std::string, std::string> KeysOf(const Planned& planned,
                                          const std::function<std::string(const std::string&)>& content) {
  std::map<std::string, std::string> keys;
  std::vector<std::string> of_task;
  for (const PlannedTask& task : planned.tasks) {
    std::string read = task.kind.str() + task.parameters;  // all that a key depends on
    for (const PlannedInput& input : task.inputs) {
      const int producer = input.task.value() - static_cast<int>(Planned::kFirst);
      // Outputs of other stages are determined by the stage's key.
      const std::string made = producer > 0 ? of_task[producer] : content(InputName(input));
      absl::StrAppend(&read, "\n", InputName(input), " ", Sha256Hex(made));
    }
    of_task.push_back(Sha256Hex(read));
    keys[task.name] = of_task.back();
  }
  return keys;
}

// An update adds a view to one cell: only the sheet of that cell, and those that read it, have other keys.
TEST(ExportTasksTest, UnchangedSheetsKeepTheirKeysInAnUpdate) {
  Survey large = SeenFromAbove(60);
  for (SurveyCell& cell : large.cells) cell.views = {0};
  Survey now = large;
  now.views.push_back(now.views[0]);
  now.views.back().image_path = "images/new.jpg";
  now.views.back().image_content = "new pixels";
  now.warnings.push_back("a warning of the update");
  const SheetId changed = SheetOf({now.cells.front().x, now.cells.front().y});
  now.cells.front().views.push_back(static_cast<int32_t>(now.views.size()) - 1);
  FillViewDepths(&now);
  for (const VertexColor color : {VertexColor::kClass, VertexColor::kImage}) {
    const auto contents = [&](const Survey& survey, const std::string& round) {
      std::map<std::string, std::string> of_name = {{SheetFileName(changed), round}, {kMeshFile, round}};
      const Survey plain = WithoutNames(survey);
      for (const SurveySheet& sheet : SheetsOf(plain)) {
        of_name[SheetViewsFileName(sheet.id)] = SheetViewsToJson(plain, sheet);
      }
      return [of_name](const std::string& name) { return of_name.contains(name) ? of_name.at(name) : name; };
    };
    const auto before = KeysOf(Planned(large, color), contents(large, " before"));
    const auto after = KeysOf(Planned(now, color), contents(now, " after"));
    ASSERT_EQ(before.size(), after.size());
    std::set<std::string> differ;
    for (const auto& [name, key] : before) {
      if (after.at(name) != key) differ.insert(name);
    }
    EXPECT_TRUE(differ.contains("export split"));
    EXPECT_TRUE(differ.contains(absl::StrCat("export plain ", SheetName(changed))));
    int far = 0;
    for (const SurveySheet& sheet : SheetsOf(large)) {
      const std::string name = SheetName(sheet.id);
      if (sheet.id == changed) continue;
      EXPECT_FALSE(differ.contains(absl::StrCat("export plain ", name))) << name;
      // A coloured neighbour of a neighbour.
      if (std::max(std::abs(sheet.id.x - changed.x), std::abs(sheet.id.y - changed.y)) <= 2) continue;
      ++far;
      EXPECT_FALSE(differ.contains(absl::StrCat("export all ", name))) << name;
    }
    EXPECT_GT(far, 0);
  }
}

TEST(ExportTasksTest, KeysDependOnPlaceClassesAndOptions) {
  const Survey survey = SeenFromAbove(20);
  const auto key = [](const Planned& planned) { return planned.Named("export split").parameters; };
  const std::string before = key(Planned(survey));
  Survey other = survey;
  other.origin_in_scene.x() += 1;
  EXPECT_NE(key(Planned(other)), before);
  other = survey;
  other.classes[0].name = "<b>";
  EXPECT_NE(key(Planned(other)), before);
}

// With the formats of the table: an export of a base's result is a given task and the exports.
TEST(ExportTasksTest, AnExportReadsTheResultOfItsBase) {
  Pair pair(4);
  pair.base.plain = DigestOf("plain");
  pair.base.mesh = DigestOf("mesh");
  pair.base.changes = DigestOf("changes");
  pair.base.quarantined = {1};
  JobSettings settings;
  settings.update.base = pair.base.name;
  settings.update.export_only = true;
  settings.exports.formats = {"changes"};
  const auto tasks = PlanUpdate(settings, pair.base.scene_files, pair.base);
  ASSERT_TRUE(tasks.ok()) << tasks.status();
  const PlannedTask& taken = tasks->front();
  EXPECT_EQ(taken.kind, kBaseKind);
  EXPECT_THAT(*taken.given, testing::UnorderedElementsAre(NamedDigest{kPlainSurveyFile, pair.base.plain},
                                                          NamedDigest{kCityFile, pair.base.city},
                                                          NamedDigest{kMeshFile, pair.base.mesh},
                                                          NamedDigest{kChangesGeoJsonFile, *pair.base.changes}));
  ASSERT_GE(tasks->size(), 3u);
  for (size_t t = 1; t < tasks->size(); ++t) EXPECT_EQ((*tasks)[t].kind, kExportKind);
  EXPECT_EQ(tasks->back().name, "export changes join");

  settings.exports.crs = "EPSG:32633";
  const Status refused = PlanUpdate(settings, pair.base.scene_files, pair.base).status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kInvalidArgument) << "the scene has no system: " << refused;
}

}  // namespace
}  // namespace tessera
