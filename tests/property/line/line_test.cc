// A job from scene to mesh, all tasks in this process.
#include <gtest/gtest.h>

#include <array>
#include <map>
#include <nlohmann/json.hpp>

#include "common/base/parallel.h"
#include "common/meshio/ply.h"
#include "common/storage/files.h"
#include "common/tile/survey.h"
#include "common/tile/task_parameters.h"
#include "tests/support/in_process_line.h"
#include "tests/support/tiny_scene.h"
#include "worker/tasks/city_file.h"
#include "worker/tasks/tile_files.h"

namespace tessera {
namespace {

// Refining that changes nothing; all other tasks as they are.
StatusOr<TaskOutcome> StandStill(const TaskRequest& request) {
  if (request.kind != "refine") return RunTask(request, {});
  TESSERA_ASSIGN_OR_RETURN(const TilePackage package, ReadTilePackage(request.input_dir + "/" + kTileFile));
  TileResult result;
  result.tile = package.tile;
  result.vertex_ids = package.vertex_ids;
  result.face_ids = package.face_ids;
  result.positions = package.mesh.vertices;
  result.classes = static_cast<int>(package.classes.size());
  result.labels = package.mesh.labels;
  for (const int32_t label : result.labels) {
    for (int l = 0; l < result.classes; ++l) result.beliefs.push_back(l == label ? 0.0f : 1.0f);
  }
  result.seen.assign(result.labels.size(), 1);
  TESSERA_RETURN_IF_ERROR(WriteTileResult(request.output_dir + "/" + kResultFile, result));
  return TaskOutcome{{kResultFile}, "{}", {}};
}

std::string RunScene(const std::string& folder, const std::string& work, int tiles, const TaskRunner& runner) {
  const auto tasks = RunLine(folder, folder + "/" + work, {.tiles = tiles}, runner);
  EXPECT_TRUE(tasks.ok()) << tasks.status();
  return tasks.ok() ? tasks->back().output_dir : "";
}

// The scene's own vertices come first and stay, in the scene's coordinates, for every kind of frame and any tiling.
TEST(Line, StandingStillGivesTheInputBack) {
  struct Case {
    const char* crs;
    Eigen::Vector3d offset;
    double tolerance_m;
  };
  const Case cases[] = {{R"({"type": "local"})", {0, 0, 0}, 0},
                        {R"({"type": "local"})", {5e6, -3e6, 100}, 1e-9},
                        {R"({"type": "utm", "zone": 32, "north": true})", {357000, 5788000, 40}, 1e-9}};
  for (const Case& c : cases) {
    TinySceneOptions options;
    options.crs_json = c.crs;
    options.offset = c.offset;
    const std::string folder = FreshTestFolder("still");
    const TinyScene scene = WriteTinyScene(folder, options);
    const auto input = ReadPly(folder + "/mesh.ply");
    ASSERT_TRUE(input.ok());
    for (const int tiles : {1, 4}) {
      if (tiles == 1 && c.tolerance_m > 0) continue;
      const std::string out = RunScene(folder, "work" + std::to_string(tiles), tiles, StandStill);
      const auto result = ReadPly(out + "/" + kMeshFile);
      ASSERT_TRUE(result.ok()) << result.status();
      ASSERT_GE(result->mesh.vertices.size(), input->mesh.vertices.size());
      for (size_t v = 0; v < input->mesh.vertices.size(); ++v) {
        EXPECT_LE((result->mesh.vertices[v] - input->mesh.vertices[v]).norm(), c.tolerance_m);
      }
    }
  }
}

// What the geometry step makes of a scene depends on its last bits, so they must not depend on where the scene lies.
TEST(Line, IngestMakesTheSameBitsOfAMovedScene) {
  std::string cities[2];
  Survey surveys[2];
  for (const int moved : {0, 1}) {
    TinySceneOptions options;
    if (moved) options.offset = Eigen::Vector3d(5000, -3000, 7) * 1024;
    const std::string in = FreshTestFolder("moved" + std::to_string(moved)), folder = in + "/" + kSceneFolder;
    const TinyScene scene = WriteTinyScene(folder, options);
    // Positions with as many digits as mapping tools write.
    TriangleMesh mesh = scene.mesh;
    for (size_t v = 0; v < mesh.vertices.size(); ++v) mesh.vertices[v].z() += 0.001 * static_cast<double>(v % 97);
    ASSERT_TRUE(WritePly(folder + "/mesh.ply", mesh).ok());
    const std::string out = folder + "/out";
    ASSERT_TRUE(EnsureFolder(out).ok());
    const auto outcome = RunTask({"ingest", ToJson(IngestParameters()), in, out}, {});
    ASSERT_TRUE(outcome.ok()) << outcome.status();
    cities[moved] = *ReadFile(out + "/" + kCityFile);
    const auto survey = ParseSurvey(*ReadFile(out + "/" + kSurveyFile));
    ASSERT_TRUE(survey.ok()) << survey.status();
    surveys[moved] = *survey;
    EXPECT_EQ(survey->origin_in_scene, options.offset);
    surveys[moved].origin_in_scene.setZero();
    surveys[moved].scene_name.clear();  // the folder's
  }
  EXPECT_EQ(cities[0], cities[1]);
  EXPECT_EQ(SurveyToJson(surveys[0]), SurveyToJson(surveys[1]));
}

TEST(Line, SameTopologyForAnyTilingAndLabelsAsGoodAsTheStart) {
  const std::string folder = FreshTestFolder("tiled");
  const TinyScene scene = WriteTinyScene(folder);
  std::vector<Triangle> faces;
  int64_t wrong_untiled = 0;
  for (const int tiles : {1, 5}) {
    const auto tasks = RunLine(folder, folder + "/work" + std::to_string(tiles), {.tiles = tiles});
    ASSERT_TRUE(tasks.ok()) << tasks.status();
    const auto city = ReadCity(tasks->front().output_dir + "/" + kCityFile);
    const auto result = ReadPly(tasks->back().output_dir + "/" + kMeshFile);
    ASSERT_TRUE(city.ok() && result.ok());
    EXPECT_EQ(result->mesh.faces, city->mesh.faces);
    if (!faces.empty()) {
      EXPECT_EQ(result->mesh.faces, faces);
    }
    faces = result->mesh.faces;
    int64_t wrong = 0;
    for (size_t f = 0; f < faces.size(); ++f) wrong += result->mesh.labels[f] != city->mesh.labels[f];
    // The start is the truth. Which faces near the seams change depends on where the seams lie.
    if (tiles == 1) {
      EXPECT_LT(wrong, static_cast<int64_t>(faces.size() / 25));
      wrong_untiled = wrong;
    }
    EXPECT_LE(static_cast<double>(wrong), 1.05 * static_cast<double>(wrong_untiled)) << tiles << " tiles";
    const auto text = ReadFile(tasks->back().output_dir + "/" + kReportFile);
    ASSERT_TRUE(text.ok());
    const nlohmann::json report = nlohmann::json::parse(*text);
    int refined = 0;
    for (const LineTask& task : *tasks) refined += task.planned.kind == "refine";
    EXPECT_EQ(report.at("tiles").size(), static_cast<size_t>(tiles));
    EXPECT_EQ(refined % tiles, 0);
    EXPECT_EQ(refined > tiles, tiles > 1) << "tiles hear from each other in between";
    EXPECT_EQ(report.at("output").at("faces").get<size_t>(), faces.size());
  }
}

// Tiles whose halo holds the whole scene differ from the untiled run in nothing but that they are cut, refined in parts
// with an exchange after each, and stitched: that changes no byte.
TEST(Line, ExchangeAndStitchingChangeNoByte) {
  const std::string folder = FreshTestFolder("exchange");
  TinySceneOptions options;
  WriteTinyScene(folder, options);
  std::vector<std::string> meshes;
  for (const int tiles : {1, 4}) {
    JobSettings settings = {.tiles = tiles, .rounds = 2};
    settings.method_settings.levels = {1, 0};
    settings.method_settings.iterations = {4, 4};
    settings.method_settings.halo_gsd = 300;
    const auto tasks = RunLine(folder, folder + "/work" + std::to_string(tiles), settings);
    ASSERT_TRUE(tasks.ok()) << tasks.status();
    int refined = 0;
    for (const LineTask& task : *tasks) refined += task.planned.kind == "refine";
    EXPECT_GE(refined, tiles == 1 ? 1 : 2 * tiles);
    meshes.push_back(ReadFile(tasks->back().output_dir + "/" + kMeshFile).value());
  }
  EXPECT_TRUE(meshes[0] == meshes[1]);
}

// The tiles' own files hold the result's faces once each, at the result's positions byte for byte.
TEST(Line, TileFilesAreTheMeshInPieces) {
  TinySceneOptions options;
  options.offset = {357000, 5788000, 40};
  const std::string folder = FreshTestFolder("tile_files");
  WriteTinyScene(folder, options);
  const auto tasks = RunLine(folder, folder + "/work", {.tiles = 5});
  ASSERT_TRUE(tasks.ok()) << tasks.status();
  const std::string out = tasks->back().output_dir;
  const std::vector<std::string>& outputs = tasks->back().outcome.outputs;
  using Corners = std::array<std::array<double, 3>, 3>;
  const auto corners_of = [](const TriangleMesh& mesh, size_t f) {
    Corners corners;
    for (int k = 0; k < 3; ++k) corners[k] = {mesh.Corner(f, k).x(), mesh.Corner(f, k).y(), mesh.Corner(f, k).z()};
    return corners;
  };
  std::map<Corners, int> in_tiles;
  const nlohmann::json index = nlohmann::json::parse(*ReadFile(out + "/" + kTileIndexFile));
  EXPECT_EQ(index.at("tiles").size(), 5u);
  for (const nlohmann::json& tile : index.at("tiles")) {
    const std::string name = "tiles/" + tile.at("file").get<std::string>();
    EXPECT_EQ(std::count(outputs.begin(), outputs.end(), name), 1);
    const auto content = ReadPly(out + "/" + name);
    ASSERT_TRUE(content.ok()) << content.status();
    const TriangleMesh& mesh = content->mesh;
    EXPECT_EQ(tile.at("faces").get<size_t>(), mesh.faces.size());
    EXPECT_EQ(tile.at("vertices").get<size_t>(), mesh.vertices.size());
    for (size_t f = 0; f < mesh.faces.size(); ++f) in_tiles[corners_of(mesh, f)] = mesh.labels[f];
    for (const Eigen::Vector3d& p : mesh.vertices) {
      for (int axis = 0; axis < 3; ++axis) {
        EXPECT_GE(p[axis], tile.at("box_min").at(axis).get<double>());
        EXPECT_LE(p[axis], tile.at("box_max").at(axis).get<double>());
      }
    }
  }
  const auto whole = ReadPly(out + "/" + kMeshFile);
  ASSERT_TRUE(whole.ok());
  EXPECT_EQ(in_tiles.size(), whole->mesh.faces.size());
  for (size_t f = 0; f < whole->mesh.faces.size(); ++f) {
    const auto it = in_tiles.find(corners_of(whole->mesh, f));
    ASSERT_NE(it, in_tiles.end()) << "face " << f;
    EXPECT_EQ(it->second, whole->mesh.labels[f]);
  }
}

TEST(Line, SameBytesForAnyNumberOfThreads) {
  const std::string folder = FreshTestFolder("threads");
  WriteTinyScene(folder);
  std::string meshes[2], reports[2];
  for (const int threads : {1, 3}) {
    const ThreadLimit limit(threads);
    const std::string out = RunScene(folder, "work" + std::to_string(threads), 4, {});
    meshes[threads / 2] = *ReadFile(out + "/" + kMeshFile);
    reports[threads / 2] = *ReadFile(out + "/" + kReportFile);
  }
  EXPECT_EQ(meshes[0], meshes[1]);
  EXPECT_EQ(reports[0], reports[1]);
}

TEST(Line, WithoutLabelsTheLikelihoodsGiveThem) {
  TinySceneOptions options;
  options.labels = false;
  const std::string folder = FreshTestFolder("unlabelled");
  const TinyScene scene = WriteTinyScene(folder, options);
  const auto result = ReadPly(RunScene(folder, "work", 2, {}) + "/" + kMeshFile);
  ASSERT_TRUE(result.ok());
  ASSERT_EQ(result->mesh.labels.size(), result->mesh.faces.size());
  for (const int32_t label : result->mesh.labels) {
    EXPECT_GE(label, 0);
    EXPECT_LT(label, 3);
  }
}

TEST(Line, WithoutLikelihoodsLabelsAreCarriedThrough) {
  TinySceneOptions options;
  options.likelihoods = TinySceneOptions::Likelihoods::kNone;
  const std::string folder = FreshTestFolder("no_likelihoods");
  WriteTinyScene(folder, options);
  const auto tasks = RunLine(folder, folder + "/work", {.tiles = 3});
  ASSERT_TRUE(tasks.ok()) << tasks.status();
  const auto city = ReadCity(tasks->front().output_dir + "/" + kCityFile);
  const auto result = ReadPly(tasks->back().output_dir + "/" + kMeshFile);
  ASSERT_TRUE(city.ok() && result.ok());
  EXPECT_EQ(result->mesh.labels, city->mesh.labels);
}

TEST(Line, WithoutBothThereIsOneClass) {
  TinySceneOptions options;
  options.likelihoods = TinySceneOptions::Likelihoods::kNone;
  options.labels = false;
  const std::string folder = FreshTestFolder("one_class");
  WriteTinyScene(folder, options);
  const auto result = ReadPly(RunScene(folder, "work", 2, {}) + "/" + kMeshFile);
  ASSERT_TRUE(result.ok()) << result.status();
  for (const int32_t label : result->mesh.labels) EXPECT_EQ(label, 0);
}

std::string RunMethod(const std::string& folder, const std::string& method) {
  JobSettings settings;
  settings.tiles = 2;
  settings.method = method;
  settings.method_settings.levels = {1, 0};
  settings.method_settings.iterations = {2, 2};
  const auto tasks = RunLine(folder, folder + "/" + method, settings);
  EXPECT_TRUE(tasks.ok()) << tasks.status();
  return tasks.ok() ? tasks->back().output_dir + "/" + kMeshFile : "";
}

TEST(Line, WithOneClassTheMethodIsTheBaseline) {
  TinySceneOptions options;
  options.likelihoods = TinySceneOptions::Likelihoods::kNone;
  options.labels = false;
  const std::string folder = FreshTestFolder("one_class_methods");
  WriteTinyScene(folder, options);
  const auto ours = ReadFile(RunMethod(folder, "tessera")), baseline = ReadFile(RunMethod(folder, "baseline"));
  ASSERT_TRUE(ours.ok() && baseline.ok());
  EXPECT_EQ(*ours, *baseline);
}

TEST(Line, AClassThatIsNowhereChangesNothing) {
  PlyContent results[2];
  for (const bool absent : {false, true}) {
    TinySceneOptions options;
    options.absent_class = absent;
    const std::string folder = FreshTestFolder(absent ? "absent" : "present");
    WriteTinyScene(folder, options);
    auto result = ReadPly(RunMethod(folder, "tessera"));
    ASSERT_TRUE(result.ok()) << result.status();
    results[absent] = *std::move(result);
  }
  EXPECT_EQ(results[0].mesh.labels, results[1].mesh.labels);
  EXPECT_EQ(results[0].mesh.vertices, results[1].mesh.vertices);
}

TEST(Line, EveryFaultOfTheSceneIsInOneMessage) {
  const std::string folder = FreshTestFolder("faults");
  const TinyScene scene = WriteTinyScene(folder);
  const auto tasks = RunLine(folder, folder + "/good", {.tiles = 1}, StandStill);
  ASSERT_TRUE(tasks.ok()) << tasks.status();
  // The plan is made; then files change.
  WriteText(folder + "/mesh.ply", "not a mesh");
  WriteText(folder + "/images/" + scene.image_names[0], "not an image");
  const TaskRequest request = {"ingest", "{}", tasks->front().output_dir + "/../in", FreshTestFolder("faults_out")};
  const Status status = RunTask(request, {}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_NE(std::string(status.message()).find("mesh.ply"), std::string::npos) << status;
  EXPECT_NE(std::string(status.message()).find(scene.image_names[0]), std::string::npos) << status;
}

// What the refine task of an untiled run tells of itself.
nlohmann::json RefineStats(const std::string& folder, const std::string& work, const JobSettings& settings) {
  const auto tasks = RunLine(folder, folder + "/" + work, settings);
  EXPECT_TRUE(tasks.ok()) << tasks.status();
  for (const LineTask& task : *tasks) {
    if (task.planned.kind == "refine") return nlohmann::json::parse(task.outcome.stats);
  }
  return {};
}

TEST(Line, MethodAndSettingsReachTheRefinement) {
  const std::string folder = FreshTestFolder("methods");
  WriteTinyScene(folder);
  JobSettings settings;
  settings.tiles = 1;
  settings.method_settings.levels = {1};
  settings.method_settings.iterations = {2};
  const auto pixels = [](const nlohmann::json& stats) {
    return stats.at("rounds").at(0).at("warped_pixels").get<int64_t>();
  };
  const nlohmann::json ours = RefineStats(folder, "ours", settings);
  EXPECT_EQ(ours.at("rounds").size(), 1u);
  EXPECT_TRUE(ours.contains("labels_first"));

  settings.method_settings.iterations = {4};
  EXPECT_GT(pixels(RefineStats(folder, "longer", settings)), pixels(ours));
  settings.method_settings.iterations = {2};
  settings.method_settings.partners = 1;
  EXPECT_LT(pixels(RefineStats(folder, "fewer", settings)), pixels(ours));
  settings.method_settings.partners.reset();
  settings.method_settings.views_per_direction = 1;
  EXPECT_LE(pixels(RefineStats(folder, "fewer_views", settings)), pixels(ours));
  settings.method_settings.views_per_direction.reset();

  settings.method = "paper";
  const nlohmann::json paper = RefineStats(folder, "paper", settings);
  EXPECT_EQ(paper.at("rounds").size(), 5u);
  EXPECT_FALSE(paper.contains("labels_first")) << "the start has labels";
  // Another label energy: the same labels cost something else.
  EXPECT_NE(paper.at("rounds").at(0).at("label_energy_start"), ours.at("rounds").at(0).at("label_energy_start"));
}

TEST(Line, AStartWithoutLabelsGetsThemBeforeTheGeometryThatKnowsThem) {
  TinySceneOptions options;
  options.labels = false;
  const std::string folder = FreshTestFolder("unlabelled_methods");
  WriteTinyScene(folder, options);
  JobSettings settings;
  settings.tiles = 1;
  settings.method_settings.levels = {1};
  settings.method_settings.iterations = {1};
  EXPECT_TRUE(RefineStats(folder, "ours", settings).contains("labels_first"));
  settings.method = "baseline";
  EXPECT_FALSE(RefineStats(folder, "baseline", settings).contains("labels_first"));
}

}  // namespace
}  // namespace tessera
