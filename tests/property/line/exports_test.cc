// Exports of jobs: the same bytes for any tiling, and from the result's folder.
#include <gtest/gtest.h>

#include <map>
#include <string>
#include <vector>

#include "common/exporting/export_format.h"
#include "common/exporting/folder/export_folder.h"
#include "common/job/task_parameters.h"
#include "common/storage/files.h"
#include "tests/support/in_process_line.h"
#include "tests/support/tiny_scene.h"
#include "worker/tile/tile_files.h"
#include "worker/tile/tile_workspace.h"

namespace tessera {
namespace {

// Replaces the steps by ones that change nothing, so that every tiling has the same result.
StatusOr<TaskOutcome> RunWithoutSteps(const TaskRequest& request) {
  if (request.kind == kMeasureKind) return TaskOutcome{{}, "{}", {}};
  if (request.kind != kRefineKind && request.kind != kSolveKind && request.kind != kMendKind) {
    return RunTask(request, {});
  }
  TESSERA_ASSIGN_OR_RETURN(TilePackage package, ReadTilePackage(request.input_dir + "/" + kTileFile));
  TileWorkspace work(std::move(package));
  TESSERA_ASSIGN_OR_RETURN(const TileSnapshot start, work.Assemble({}, 0));
  TESSERA_RETURN_IF_ERROR(WriteTileState(request.output_dir + "/" + kStateFile, work.StateOf(start)));
  return TaskOutcome{{kStateFile}, "{}", {}};
}

std::vector<std::string> FormatsOfAnyResult() {
  std::vector<std::string> names;
  for (const ExportFormat& format : ExportFormats()) {
    if (!format.reads_changes) names.emplace_back(format.name);
  }
  return names;
}

// The delivered files by name.
std::map<std::string, std::string> ExportedBy(const std::vector<LineTask>& tasks) {
  std::map<std::string, std::string> files;
  for (const LineTask& task : tasks) {
    if (task.planned.kind != kExportKind) continue;
    for (const std::string& name : task.outcome.outputs) {
      if (!name.starts_with(kExportFolder)) continue;
      EXPECT_TRUE(files.emplace(name, ReadText(task.output_dir + "/" + name)).second) << name << " twice";
    }
  }
  return files;
}

// The job's result as a folder gives the same files, where a sheet is not an archive and no format shows displacements.
void ExpectFromFolder(const std::vector<LineTask>& tasks, const std::string& scene, const ExportSettings& exports,
                      const std::map<std::string, std::string>& files) {
  const std::string folder = FreshTestFolder("exports_result");
  for (const LineTask& task : tasks) {
    if (task.planned.kind != kPublishKind) continue;
    for (const char* name : {kMeshFile, kReportFile}) {
      ASSERT_TRUE(WriteFileAtomic(folder + "/" + name, ReadText(task.output_dir + "/" + name)).ok());
    }
  }
  ExportRequest request;
  request.result = folder;
  request.out = folder + "/out";
  request.scene = scene;
  request.options.formats = {"dsm", "glb", "obj", "ortho", "ply"};
  request.options.color = *FindVertexColor(exports.color);
  Warnings warnings;
  const auto exported = ExportFolder(request, &warnings, {});
  ASSERT_TRUE(exported.ok()) << exported.status();
  int compared = 0;
  for (const auto& [name, content] : files) {
    const std::string path = request.out + "/" + name.substr(std::string(kExportFolder).size());
    if (!FileExists(path)) continue;
    EXPECT_TRUE(ReadText(path) == content) << name << " of " << exports.color;
    ++compared;
  }
  EXPECT_GE(compared, 5);
  EXPECT_TRUE(RemoveTree(folder).ok());
}

TEST(LineExports, HaveTheSameBytesForAnyTiling) {
  if (FormatsOfAnyResult().empty()) GTEST_SKIP() << "no format exports any result";
  const std::string folder = FreshTestFolder("exports");
  WriteTinyScene(folder);
  std::map<std::string, std::string> expected;
  for (const char* color : {"class", "image"}) {
    for (const int tiles : {1, 3}) {
      JobSettings settings = {.tiles = tiles};
      settings.exports.formats = FormatsOfAnyResult();
      settings.exports.color = color;
      const std::string work = folder + "/" + color + std::to_string(tiles);
      const auto tasks = RunLine(folder, work, settings, RunWithoutSteps);
      ASSERT_TRUE(tasks.ok()) << tasks.status();
      const std::map<std::string, std::string> files = ExportedBy(*tasks);
      for (const std::string& format : settings.exports.formats) {
        const std::string prefix = kExportFolder + format + "/";
        const auto found = files.lower_bound(prefix);
        EXPECT_TRUE(found != files.end() && found->first.starts_with(prefix)) << format << " delivers nothing";
      }
      if (tiles == 1) {
        expected = files;
        ExpectFromFolder(*tasks, folder, settings.exports, files);
      }
      ASSERT_EQ(files.size(), expected.size());
      for (const auto& [name, content] : files) EXPECT_TRUE(content == expected[name]) << name << " of " << color;
    }
  }
  EXPECT_TRUE(RemoveTree(folder).ok());
}

}  // namespace
}  // namespace tessera
