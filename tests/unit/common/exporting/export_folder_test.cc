#include "common/exporting/folder/export_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/base/parallel.h"
#include "common/exporting/export_map.h"
#include "common/exporting/folder/staging.h"
#include "common/meshio/ply.h"
#include "common/scene/scene.h"
#include "common/storage/files.h"
#include "common/storage/hash.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

// Formats that write what they get.
StatusOr<std::vector<std::string>> WriteFacts(const SheetInput& input, const std::string& folder, const TaskControl&) {
  double displacement_m = 0;
  for (const float d : input.sheet.displacement_m) displacement_m += d;
  const std::string text =
      absl::StrFormat("%s %d faces %d neighbours %s start %d views %d displaced %.3f m confidence %d%s\n",
                      SheetName(input.id), input.sheet.faces.size(), input.neighbours.size(),
                      input.start ? "with" : "without", input.views.size(), input.sheet.displacement_m.size(),
                      displacement_m, input.sheet.confidence.size(), input.set_aside ? " set aside" : "");
  const std::string name = absl::StrCat("data/", SheetName(input.id), ".txt");
  TESSERA_RETURN_IF_ERROR(EnsureFolder(absl::StrCat(folder, "/data")));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(absl::StrCat(folder, "/", name), text));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(absl::StrCat(folder, "/", kPartFile), text));
  return std::vector<std::string>{name};
}

StatusOr<std::vector<std::string>> JoinFacts(const JoinInput& input, const std::string& folder, const TaskControl&) {
  std::string all;
  for (const JoinInput::Item& item : input.sheets) {
    TESSERA_ASSIGN_OR_RETURN(const std::string part, ReadFile(item.part_path));
    TESSERA_ASSIGN_OR_RETURN(const Sheet sheet, ReadSheet(item.sheet_path));
    absl::StrAppend(&all, part);
  }
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(absl::StrCat(folder, "/all.txt"), all));
  return std::vector<std::string>{"all.txt"};
}

StatusOr<std::vector<std::string>> FailAtJoin(const JoinInput&, const std::string& folder, const TaskControl&) {
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(absl::StrCat(folder, "/half.txt"), "half"));
  return absl::InternalError("failed on purpose");
}

constexpr ExportFormat kTestFormats[] = {
    {.name = "changes", .what = "", .reads_changes = true},
    {.name = "failing", .what = "", .write_sheet = WriteFacts, .join = FailAtJoin},
    {.name = "facts",
     .what = "",
     .reads_neighbours = true,
     .reads_start = true,
     .colored = true,
     .has_part = true,
     .join_reads_sheets = true,
     .write_sheet = WriteFacts,
     .join = JoinFacts},
    {.name = "globe", .what = "", .on_globe = true, .write_sheet = WriteFacts},
    {.name = "photos", .what = "", .reads_photographs = true, .write_sheet = WriteFacts},
    {.name = "plain", .what = "", .write_sheet = WriteFacts},
};

std::map<std::string, std::string> FilesIn(const std::string& folder) {
  std::map<std::string, std::string> files;
  const StatusOr<std::vector<std::string>> names = ListFiles(folder);
  if (!names.ok()) return files;
  for (const std::string& name : *names) files[name] = ReadFile(absl::StrCat(folder, "/", name)).value();
  return files;
}

// The tiny scene in UTM as a result that lies 0.125 m above its start, with sheets of 16 m.
class ExportFolderTest : public testing::Test {
 protected:
  ExportFolderTest() : folder_(FreshTestFolder("export_folder")) {
    TinySceneOptions tiny;
    tiny.crs_json = R"({"type": "utm", "zone": 32, "north": true})";
    tiny.offset = {691200.25, 5334016.5, 520};
    mesh_ = WriteTinyScene(folder_ + "/scene", tiny).mesh;
    for (Eigen::Vector3d& p : mesh_.vertices) p.z() += 0.125;
    PlyWriteOptions write;
    write.face_confidence.assign(mesh_.faces.size(), 0.5f);
    request_.result = folder_ + "/result";
    request_.out = folder_ + "/out";
    request_.options.formats = {"facts", "plain"};
    EXPECT_TRUE(EnsureFolder(request_.result).ok());
    EXPECT_TRUE(WritePly(request_.result + "/mesh.ply", mesh_, write).ok());
    Crs crs;
    crs.kind = Crs::Kind::kUtm;
    crs.zone = 32;
    scene_.frame = Frame::Around(crs, tiny.offset).value();
    scene_.gsd_m = 0.2;
    scene_.ground = MakeGroundPlane(scene_.up, 1);
    for (const char* name : {"ground", "facade", "roof"}) scene_.classes.emplace_back().name = name;
    WriteReport(/*with_frame=*/true);
  }

  void WriteReport(bool with_frame, bool failed = false) {
    nlohmann::json report = {{"gsd_m", 0.2}, {"classes", {"ground", "facade", "roof"}}};
    if (with_frame) report["frame"] = nlohmann::json::parse(ExportSceneToJson(scene_));
    if (failed) report["tiles"] = {{{"tile", 0}, {"quarantined", true}}};
    WriteText(request_.result + "/report.json", report.dump());
  }
  StatusOr<std::vector<ExportedFormat>> Export(const TaskControl& control = {}) {
    warnings_.clear();
    return ExportFolder(request_, &warnings_, control, kTestFormats);
  }
  std::string Message() { return std::string(Export().status().message()); }
  nlohmann::json Index() const { return nlohmann::json::parse(ReadText(request_.out + "/export.json")); }

  const std::string folder_;
  TriangleMesh mesh_;
  ExportScene scene_;
  ExportRequest request_;
  Warnings warnings_;
};

TEST_F(ExportFolderTest, WritesTheFilesOfAllFormatsAndTheirIndex) {
  request_.scene = folder_ + "/scene";
  const auto exported = Export();
  ASSERT_TRUE(exported.ok()) << exported.status();
  ASSERT_EQ(exported->size(), 2u);
  EXPECT_EQ((*exported)[0].name, "facts");
  const nlohmann::json index = Index();
  EXPECT_EQ(index["crs"], "");
  EXPECT_EQ(index["formats"], nlohmann::json({"facts", "plain"}));
  EXPECT_THAT(index["left_out"], testing::IsEmpty());
  const size_t sheets = index["sheets"].size();
  EXPECT_GE(sheets, 9u);
  EXPECT_EQ((*exported)[0].files, static_cast<int64_t>(sheets) + 1);
  size_t faces = 0;
  for (const nlohmann::json& sheet : index["sheets"]) {
    faces += sheet["faces"].get<size_t>();
    EXPECT_FALSE(sheet["set_aside"].get<bool>());
    EXPECT_GE(sheet["box_min"][0], 691200.25 - 20);
    EXPECT_LE(sheet["box_max"][1], 5334016.5 + 20);
    EXPECT_LE(sheet["box_min"][2], sheet["box_max"][2]);
  }
  EXPECT_EQ(faces, mesh_.faces.size());
  std::map<std::string, std::string> files = FilesIn(request_.out);
  EXPECT_EQ(files.size(), 2 * sheets + 2) << "all sheets twice, all.txt, export.json";
  for (const nlohmann::json& file : index["files"]) {
    const std::string& content = files.at(file["file"]);
    EXPECT_EQ(file["sha256"], Sha256Hex(content));
    EXPECT_EQ(file["bytes"], content.size());
  }
  EXPECT_EQ(index["files"].size(), files.size() - 1);
  EXPECT_FALSE(fs::exists(request_.out + "/.export"));
  const std::string all = files.at("facts/all.txt");
  EXPECT_EQ(static_cast<size_t>(std::count(all.begin(), all.end(), '\n')), sheets) << all;
  EXPECT_THAT(all, AllOf(HasSubstr("8 neighbours with start 0 views"), Not(HasSubstr("displaced 0 "))));
  EXPECT_THAT(all, Not(HasSubstr("confidence 0")));
}

TEST_F(ExportFolderTest, DisplacementIsTheDistanceToTheStartMesh) {
  request_.options.formats = {"facts"};
  request_.start = folder_ + "/scene/mesh.ply";
  ASSERT_TRUE(Export().ok());
  // A vertex of the ground or the roof is 0.125 m above its start; those of facades lie on it or below an edge.
  const std::string all = ReadText(request_.out + "/facts/all.txt");
  const SheetId corner = SheetOf(scene_.ground.Cell(scene_.frame.LocalFromScene(mesh_.vertices[0])));
  const std::string line = all.substr(all.find(SheetName(corner) + " "));
  int faces = 0, neighbours = 0, views = 0, vertices = 0;
  double displacement_m = 0;
  ASSERT_EQ(std::sscanf(line.c_str(), "%*s %d faces %d neighbours with start %d views %d displaced %lf", &faces,
                        &neighbours, &views, &vertices, &displacement_m),
            5)
      << line;
  EXPECT_EQ(neighbours, 3) << "a corner of the city";
  EXPECT_NEAR(displacement_m, 0.125 * vertices, 1e-3);
}

TEST_F(ExportFolderTest, GivesTheSameBytesAgainAndWithOtherThreads) {
  request_.scene = folder_ + "/scene";
  ASSERT_TRUE(Export().ok());
  const auto files = FilesIn(request_.out);
  request_.out = folder_ + "/again";
  const ThreadLimit one(1);
  ASSERT_TRUE(Export().ok());
  EXPECT_EQ(FilesIn(request_.out), files);
}

TEST_F(ExportFolderTest, WithoutASceneTheStartIsLeftOut) {
  ASSERT_TRUE(Export().ok());
  EXPECT_THAT(Index()["left_out"].dump(), HasSubstr("facts: the start mesh, because neither --scene nor --start"));
  EXPECT_THAT(ReadText(request_.out + "/facts/all.txt"),
              AllOf(HasSubstr("without start"), HasSubstr(" displaced 0.0")));
}

TEST_F(ExportFolderTest, PhotographsAreThoseThatShowTheSheet) {
  request_.scene = folder_ + "/scene";
  request_.options.formats = {"photos"};
  ASSERT_TRUE(Export().ok());
  EXPECT_THAT(ReadText(request_.out + "/photos/data/" + Index()["sheets"][0]["sheet"].get<std::string>() + ".txt"),
              testing::ContainsRegex("[1-5] views"));
  const fs::path images = folder_ + "/scene/images";
  for (const auto& image : fs::directory_iterator(images)) fs::remove(image);
  request_.out = folder_ + "/other";
  EXPECT_THAT(Message(), HasSubstr("images: found no files of 5 of the 5 images"));
  request_.options.formats = {"plain"};
  EXPECT_EQ(Export().status(), absl::OkStatus()) << "needs no photographs";
}

TEST_F(ExportFolderTest, PhotographsAreThoseThatTheJobChose) {
  request_.scene = folder_ + "/scene";
  request_.options.formats = {"photos"};
  ASSERT_TRUE(Export().ok());
  const nlohmann::json index = Index();
  nlohmann::json sheets = nlohmann::json::object();
  for (const nlohmann::json& sheet : index["sheets"]) sheets[sheet["sheet"].get<std::string>()] = "";
  const std::string chosen = sheets.begin().key();
  sheets[chosen] = "1 2";
  const StatusOr<SceneDescription> scene = LoadScene(folder_ + "/scene", nullptr);
  ASSERT_TRUE(scene.ok()) << scene.status();
  nlohmann::json report = nlohmann::json::parse(ReadText(request_.result + "/report.json"));
  // The last view has no photograph any more.
  report["views_of_sheets"] = {{"names", {scene->views[0].name, scene->views[3].name, "gone"}}, {"sheets", sheets}};
  WriteText(request_.result + "/report.json", report.dump());
  request_.out = folder_ + "/other";
  const auto exported = Export();
  ASSERT_TRUE(exported.ok()) << exported.status();
  for (const auto& [sheet, views] : sheets.items()) {
    EXPECT_THAT(ReadText(request_.out + "/photos/data/" + sheet + ".txt"),
                HasSubstr(sheet == chosen ? " 1 views" : " 0 views"));
  }
}

TEST_F(ExportFolderTest, FilesWithoutAPlaceOnTheGlobeAreWarnedOf) {
  request_.options.formats = {"globe", "plain"};
  ASSERT_TRUE(Export().ok());
  EXPECT_THAT(warnings_, testing::IsEmpty());
  scene_.frame = Frame::Around({}, scene_.frame.origin_in_scene()).value();
  WriteReport(/*with_frame=*/true);
  request_.out += "2";
  ASSERT_TRUE(Export().ok());
  EXPECT_THAT(warnings_, testing::ElementsAre(HasSubstr("globe: the scene has no coordinate reference system")));
}

TEST_F(ExportFolderTest, VerticesThatNoPhotographShowsAreWarnedOf) {
  const auto v = static_cast<uint32_t>(mesh_.vertices.size());
  for (const Eigen::Vector3d& p : {Eigen::Vector3d(0, 0, -5), Eigen::Vector3d(0, 1, -5), Eigen::Vector3d(1, 0, -5)}) {
    mesh_.vertices.push_back(mesh_.vertices[0] + p);  // below the ground, seen from below
  }
  mesh_.faces.push_back({v, v + 1, v + 2});
  mesh_.labels.push_back(0);
  ASSERT_TRUE(WritePly(request_.result + "/mesh.ply", mesh_).ok());
  request_.scene = folder_ + "/scene";
  request_.options.color = VertexColor::kImage;
  const auto exported = Export();
  ASSERT_TRUE(exported.ok()) << exported.status();
  EXPECT_THAT(warnings_, testing::Contains(HasSubstr("no photograph shows")));
}

TEST_F(ExportFolderTest, ResultsOfEarlierVersionsTakeTheFrameOfTheScene) {
  WriteReport(/*with_frame=*/false);
  EXPECT_THAT(Message(), AllOf(HasSubstr("report.json: frame: found no such member"), HasSubstr("--scene SCENE")));
  request_.options.formats = {"facts", "nonsense"};
  EXPECT_THAT(Message(), AllOf(HasSubstr("'nonsense'"), HasSubstr("--scene SCENE")));
  request_.options.formats = {"facts", "plain"};
  request_.scene = folder_ + "/scene";
  ASSERT_TRUE(Export().ok());
  EXPECT_THAT(warnings_, testing::IsEmpty()) << "the job has given those of the scene";
  EXPECT_EQ(Index()["sheets"].size(), 4u) << "cells of 16 m, as CellSide_m of the GSD says";
}

TEST_F(ExportFolderTest, FaultsAreReportedTogetherBeforeWork) {
  request_.options.formats = {"changes", "nonsense", "photos"};
  request_.options.crs = "EPSG:999999";
  request_.options.gsd_m = -1;
  EXPECT_THAT(Message(), AllOf(HasSubstr("found 'nonsense'"), HasSubstr("EPSG:999999"), HasSubstr("gsd: found -1"),
                               HasSubstr("--scene: found none"), HasSubstr("no file changes.geojson")));
  EXPECT_FALSE(fs::exists(request_.out));
  request_.options = {};
  request_.options.formats = {"facts"};
  request_.options.color = VertexColor::kDisplacement;
  EXPECT_THAT(Message(), HasSubstr("displacement without a start mesh"));
  request_.result = folder_ + "/scene/images";
  EXPECT_THAT(Message(), AllOf(HasSubstr("no file mesh.ply"), HasSubstr("tessera fetch")));
}

TEST_F(ExportFolderTest, SceneOfAnotherResultIsRefused) {
  WriteText(
      request_.result + "/report.json",
      nlohmann::json{{"frame", nlohmann::json::parse(ExportSceneToJson(scene_))}, {"classes", {"a", "b"}}}.dump());
  request_.scene = folder_ + "/scene";
  EXPECT_THAT(Message(), HasSubstr("found ground, facade, roof, expected those of the result (a, b)"));
}

TEST_F(ExportFolderTest, LabelsThatAreNoClassAreErrors) {
  mesh_.labels[3] = 3;
  ASSERT_TRUE(WritePly(request_.result + "/mesh.ply", mesh_).ok());
  EXPECT_THAT(Message(), HasSubstr("face 3: found label 3, expected 0 to 2"));
  EXPECT_FALSE(fs::exists(request_.out));
}

TEST_F(ExportFolderTest, PartsThatTheSystemDoesNotCoverAreErrors) {
  const auto v = static_cast<uint32_t>(mesh_.vertices.size());
  for (const Eigen::Vector3d& p : {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 1, 0)}) {
    mesh_.vertices.push_back(Eigen::Vector3d(9e8, 5334016, 520) + p);
  }
  mesh_.faces.push_back({v, v + 1, v + 2});
  mesh_.labels.push_back(0);
  ASSERT_TRUE(WritePly(request_.result + "/mesh.ply", mesh_).ok());
  request_.options.crs = "EPSG:25833";
  EXPECT_THAT(Message(), AllOf(HasSubstr("sheet "), HasSubstr("the system does not cover it")));
  EXPECT_FALSE(fs::exists(request_.out));
}

TEST_F(ExportFolderTest, TooLittleSpaceIsAnErrorBeforeWork) {
  fs::resize_file(request_.result + "/mesh.ply", fs::space(folder_).available);  // takes no space
  const Status status = Export().status();
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr("name a folder on another disk with --out"));
  EXPECT_FALSE(fs::exists(request_.out));
}

TEST_F(ExportFolderTest, SheetsOfFailedTilesAreFlagged) {
  WriteReport(/*with_frame=*/true, /*failed=*/true);
  ASSERT_TRUE(Export().ok());
  for (const nlohmann::json& sheet : Index()["sheets"]) EXPECT_TRUE(sheet["set_aside"].get<bool>());
  EXPECT_THAT(warnings_, testing::Contains(HasSubstr("may show tiles whose refinement failed")));

  // With an index of tiles it is known where they are.
  const nlohmann::json sheet = Index()["sheets"][0];
  SheetId id;
  ASSERT_EQ(std::sscanf(sheet["sheet"].get<std::string>().c_str(), "%d_%d", &id.x, &id.y), 2);
  const CellRect cells = CellsOf(id);
  fs::create_directories(request_.result + "/tiles");
  WriteText(request_.result + "/tiles/index.json",
            nlohmann::json{{"tiles",
                            {{{"core_cells", {cells.x0 - 5, cells.y0, cells.x0 + 1, cells.y1}}, {"quarantined", true}},
                             {{"core_cells", {cells.x0 + 1, cells.y0, cells.x1 + 99, cells.y1}}}}}}
                .dump());
  request_.out = folder_ + "/other";
  ASSERT_TRUE(Export().ok());
  const nlohmann::json sheets = Index()["sheets"];
  for (size_t s = 0; s < sheets.size(); ++s) EXPECT_EQ(sheets[s]["set_aside"], s == 0) << s;
  EXPECT_THAT(warnings_, testing::Contains(HasSubstr("1 of ")));
}

TEST_F(ExportFolderTest, FailedOrCancelledExportsLeaveNothing) {
  request_.options.formats = {"failing", "plain"};
  EXPECT_THAT(Message(), HasSubstr("failed on purpose"));
  EXPECT_FALSE(fs::exists(request_.out));
  // At every point where it may be cancelled.
  request_.options.formats = {"facts"};
  std::atomic<int> calls = 0, left = 1 << 30;
  TaskControl control;
  control.cancelled = [&] { return ++calls, --left < 0; };
  ASSERT_TRUE(Export(control).ok());
  fs::remove_all(request_.out);
  const int all = calls;
  ASSERT_GT(all, 20);
  for (const int after : {0, all / 4, all / 2, all - 1}) {
    left = after;
    EXPECT_EQ(Export(control).status().code(), absl::StatusCode::kCancelled) << after;
    EXPECT_FALSE(fs::exists(request_.out)) << after;
  }
}

TEST_F(ExportFolderTest, OtherFilesAreKeptAndAnInterruptedExportIsReplaced) {
  WriteText(folder_ + "/out-file", "mine");
  request_.out = folder_ + "/out-file";
  EXPECT_EQ(Export().status().code(), absl::StatusCode::kAlreadyExists);
  request_.out = folder_ + "/out";
  fs::create_directories(request_.out);
  WriteText(request_.out + "/mine", "mine");
  EXPECT_EQ(Export().status().code(), absl::StatusCode::kAlreadyExists);
  EXPECT_EQ(FilesIn(request_.out).size(), 1u);
  fs::remove(request_.out + "/mine");
  // Killed while the files got their names: one format is whole.
  fs::create_directories(request_.out + "/.export/files/plain");
  fs::create_directories(request_.out + "/facts/data");
  WriteText(request_.out + "/.export/files/plain/half.txt", "half");
  WriteText(request_.out + "/facts/data/old.txt", "old");
  ASSERT_TRUE(Export().ok());
  const auto files = FilesIn(request_.out);
  EXPECT_EQ(files.count("facts/data/old.txt"), 0u);
  EXPECT_EQ(files.count("plain/half.txt"), 0u);
  EXPECT_EQ(files.count("export.json"), 1u);
  EXPECT_EQ(Export().status().code(), absl::StatusCode::kAlreadyExists) << "the finished export";
}

TEST_F(ExportFolderTest, TwoExportsOfOneFolderAreRefused) {
  const StatusOr<ExportStaging> other = ExportStaging::Open(request_.out);
  ASSERT_TRUE(other.ok()) << other.status();
  EXPECT_THAT(Message(), HasSubstr("another export writes to this folder"));
}

}  // namespace
}  // namespace tessera
