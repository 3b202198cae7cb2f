// Exports of jobs with the real executables: --formats, ExportJob and `tessera export jobs/N`.
#include "server/client/export_job.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <optional>

#include "common/exporting/export_format.h"
#include "tests/e2e/programs.h"

namespace tessera::e2e {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

// The first of these formats that exists; empty: none.
std::string AFormat() {
  for (const char* name : {"ply", "obj", "3dtiles"}) {
    if (FindExportFormat(name) != nullptr) return name;
  }
  return "";
}

// The files below a folder by their relative path.
std::map<std::string, std::string> FilesBelow(const std::string& folder) {
  std::map<std::string, std::string> files;
  if (!fs::exists(folder)) return files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) files[fs::relative(entry.path(), folder)] = Content(entry.path());
  }
  return files;
}

class ExportJobTest : public testing::Test {
 protected:
  void SetUp() override {
    if (AFormat().empty()) GTEST_SKIP() << "no format exports any result";
    folder_ = TempFolder::Create(testing::TempDir()).value();
  }
  std::string Path(const std::string& name) const { return folder_->path() + "/" + name; }
  Outcome Try(const std::vector<std::string>& arguments) { return Tessera(folder_->path(), arguments); }
  std::string Run(const std::vector<std::string>& arguments) {
    const Outcome outcome = Try(arguments);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
    return outcome.output;
  }
  // Exports jobs/1 of a cluster to a folder of this name.
  std::map<std::string, std::string> Export(Cluster& cluster, const std::string& name) {
    Run({"export", "jobs/1", "--to", AFormat(), "--out", Path(name), "--coordinator", cluster.address()});
    return FilesBelow(Path(name) + "/" + AFormat());
  }

  std::optional<TempFolder> folder_;
};

// The result of the street in eight tiles: jobs/1 of a cluster that was not there when it was made.
TEST_F(ExportJobTest, AnEndedJobIsExportedAndKept) {
  CopyStreetResult(Path("1"));
  fs::rename(Path("1/.tessera/data"), Path("data"));
  Cluster cluster(folder_->path());
  cluster.AddWorker();
  const auto files = Export(cluster, "first");
  ASSERT_FALSE(files.empty());
  for (const auto& [name, content] : files) {
    EXPECT_FALSE(name.ends_with(".zip")) << "archives of sheets are unpacked";
    EXPECT_FALSE(content.empty()) << name;
  }
  // Again: every task is found by its key.
  EXPECT_EQ(Export(cluster, "second"), files);
  for (const v1::Task& task : cluster.Tasks("jobs/3")) {
    EXPECT_TRUE(task.kind() == "base" || task.kind() == "export") << task.kind();
    EXPECT_TRUE(task.kind() == "base" || task.reused()) << task.title();
  }
  // In one run with as many workers.
  Run({"run", Street(), "--tiles", "8", "--formats", AFormat(), "--workers", "3", "--out", Path("run")});
  EXPECT_EQ(FilesBelow(Path("run/export/" + AFormat())), files);

  // The base is kept while the exports exist.
  const Outcome refused = Try({"delete", "jobs/1", "--coordinator", cluster.address()});
  EXPECT_NE(refused.exit_code, 0);
  EXPECT_THAT(refused.output, HasSubstr("delete jobs/2, jobs/3 first"));
  for (const char* job : {"jobs/2", "jobs/3", "jobs/1"}) Run({"delete", job, "--coordinator", cluster.address()});
}

TEST_F(ExportJobTest, AKilledWorkerChangesNothing) {
  CopyStreetResult(Path("1"));
  fs::rename(Path("1/.tessera/data"), Path("data"));
  Cluster cluster(folder_->path());
  const auto created =
      SubmitExport(cluster.connection(), "jobs/1", ExportSettings{.formats = {AFormat()}, .crs = {}, .color = "image"});
  ASSERT_TRUE(created.ok()) << created.status();
  Program& worker = cluster.AddWorker();
  const auto one_is_done = [&] {
    const std::vector<v1::Task> tasks = cluster.Tasks(*created);
    return std::any_of(tasks.begin(), tasks.end(), [](const v1::Task& task) {
      return task.kind() == "export" && task.state() == v1::TASK_STATE_SUCCEEDED;
    });
  };
  ASSERT_TRUE(WaitUntil(one_is_done));
  worker.Kill();
  for (int i = 0; i < 3; ++i) cluster.AddWorker();
  ASSERT_EQ(cluster.Await(*created).state(), v1::JOB_STATE_SUCCEEDED);
  ASSERT_TRUE(FetchExports(cluster.connection(), *created, Path("killed"), TaskControl()).ok());

  const TempFolder other = TempFolder::Create(testing::TempDir()).value();
  CopyStreetResult(other.path() + "/1");
  fs::rename(other.path() + "/1/.tessera/data", other.path() + "/data");
  Cluster undisturbed(other.path());
  undisturbed.AddWorker();
  Run({"export", "jobs/1", "--to", AFormat(), "--color", "image", "--out", other.path() + "/out", "--coordinator",
       undisturbed.address()});
  EXPECT_EQ(FilesBelow(Path("killed")), FilesBelow(other.path() + "/out"));
}

// An update without a change exports the same bytes; none of its tasks but split runs again.
TEST_F(ExportJobTest, AnUpdateKeepsUnchangedSheets) {
  CopyStreetResult(Path("1"));
  Run({"run", Street(), "--base", Path("1"), "--formats", AFormat(), "--out", Path("2")});
  Run({"run", Street(), "--base", Path("1"), "--formats", AFormat(), "--out", Path("3"), "--data",
       Path("1/.tessera/data")});
  const auto files = FilesBelow(Path("2/export"));
  ASSERT_FALSE(files.empty());
  EXPECT_EQ(FilesBelow(Path("3/export")), files);
}

TEST_F(ExportJobTest, WhatCannotBeExportedIsRefusedBeforeWork) {
  CopyStreetResult(Path("1"));
  fs::rename(Path("1/.tessera/data"), Path("data"));
  Cluster cluster(folder_->path());
  const auto expect = [&](const ExportSettings& settings, const std::string& words) {
    const auto created = SubmitExport(cluster.connection(), "jobs/1", settings);
    EXPECT_EQ(created.status().code(), absl::StatusCode::kInvalidArgument) << created.status();
    EXPECT_THAT(std::string(created.status().message()), HasSubstr(words));
  };
  expect({}, "found no formats");
  expect({{"<img src=x onerror=alert(1)>"}, "", "", 0, false}, "formats: found '<img src=x onerror=alert(1)>'");
  expect({{AFormat(), "../x"}, "", "", 0, false}, "formats: found '../x'");
  expect({{AFormat()}, "", "mauve", 0, false}, "color: found 'mauve'");
  expect({{AFormat()}, "", "", -1, false}, "gsd: found -1");
  expect({{AFormat()}, "EPSG:nothing", "", 0, false}, "EPSG:nothing");
  expect({{AFormat()}, std::string(100'000, '9'), "", 0, false}, "settings");
  const auto missing = SubmitExport(cluster.connection(), "jobs/7", {{AFormat()}, "", "", 0, false});
  EXPECT_EQ(missing.status().code(), absl::StatusCode::kNotFound) << missing.status();
  // The same words on the command line; nothing is run or written.
  const Outcome refused = Try({"run", Street(), "--formats", AFormat() + ",paper", "--out", Path("none")});
  EXPECT_NE(refused.exit_code, 0);
  EXPECT_THAT(refused.output, HasSubstr("formats: found 'paper', expected some of "));
  EXPECT_FALSE(fs::exists(Path("none")));
}

}  // namespace
}  // namespace tessera::e2e
