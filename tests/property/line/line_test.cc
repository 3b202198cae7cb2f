// Jobs from scene to mesh, with all tasks in this process.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

#include "common/base/parallel.h"
#include "common/geometry/mesh_defects.h"
#include "common/imaging/image_io.h"
#include "common/job/refine_steps.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "common/meshio/ply.h"
#include "common/storage/files.h"
#include "tests/property/line/same_mesh.h"
#include "tests/property/line/strip.h"
#include "tests/support/in_process_line.h"
#include "tests/support/quad_mesh.h"
#include "tests/support/read_city.h"
#include "tests/support/tiny_scene.h"
#include "worker/city/city_file.h"
#include "worker/tile/tile_files.h"
#include "worker/tile/tile_workspace.h"

namespace tessera {
namespace {

// Replaces the steps by ones that change nothing; all other tasks run normally.
StatusOr<TaskOutcome> StandStill(const TaskRequest& request) {
  if (request.kind == "measure") return TaskOutcome{{}, "{}", {}};
  if (request.kind != "refine" && request.kind != "solve" && request.kind != "mend") return RunTask(request, {});
  TESSERA_ASSIGN_OR_RETURN(TilePackage package, ReadTilePackage(request.input_dir + "/" + kTileFile));
  TileWorkspace work(std::move(package));
  TESSERA_ASSIGN_OR_RETURN(const TileSnapshot start, work.Assemble({}, 0));
  TESSERA_RETURN_IF_ERROR(WriteTileState(request.output_dir + "/" + kStateFile, work.StateOf(start)));
  return TaskOutcome{{kStateFile}, "{}", {}};
}

int64_t CountTasks(const std::vector<LineTask>& tasks, const std::string& kind) {
  return std::count_if(tasks.begin(), tasks.end(), [&](const LineTask& task) { return task.planned.kind == kind; });
}

std::string RunScene(const std::string& folder, const std::string& work, const JobSettings& settings,
                     const TaskRunner& runner = {}) {
  const auto tasks = RunLine(folder, folder + "/" + work, settings, runner);
  EXPECT_TRUE(tasks.ok()) << tasks.status();
  return tasks.ok() ? tasks->back().output_dir : "";
}

// The scene's own vertices come first and unchanged, in the scene's coordinates, for every kind of frame and any
// tiling.
TEST(Line, ZeroStepsReturnTheInput) {
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
      const std::string out = RunScene(folder, "work" + std::to_string(tiles), {.tiles = tiles}, StandStill);
      const auto result = ReadPly(out + "/" + kMeshFile);
      ASSERT_TRUE(result.ok()) << result.status();
      ASSERT_GE(result->mesh.vertices.size(), input->mesh.vertices.size());
      for (size_t v = 0; v < input->mesh.vertices.size(); ++v) {
        EXPECT_LE((result->mesh.vertices[v] - input->mesh.vertices[v]).norm(), c.tolerance_m);
      }
    }
  }
}

// The geometry step depends on the last bits of positions, so these must not depend on where the scene is.
TEST(Line, IngestIsBitIdenticalForATranslatedScene) {
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
    surveys[moved].scene_name.clear();  // the name of the folder
    EXPECT_FALSE(survey->fit.empty());
    surveys[moved].fit.clear();  // measured with the cameras of the file, which are not on the local grid
  }
  EXPECT_EQ(cities[0], cities[1]);
  EXPECT_EQ(SurveyToJson(surveys[0]), SurveyToJson(surveys[1]));
}

// Quads with labels as floats are the same scene as their triangles.
TEST(Line, MeshesOfOtherProgramsGiveTheSameResult) {
  const std::string folder = FreshTestFolder("other");
  const TinyScene scene = WriteTinyScene(folder);
  const std::string triangles = RunScene(folder, "triangles", {.tiles = 2});
  WriteText(folder + "/mesh.ply", QuadPly(scene.mesh));
  const std::string quads = RunScene(folder, "quads", {.tiles = 2});
  EXPECT_TRUE(SameMesh(triangles + "/" + kMeshFile, quads + "/" + kMeshFile));
  EXPECT_NE(ReadText(quads + "/" + kReportFile).find("faces of more than 3 vertices split into"), std::string::npos);
}

TEST(Line, ResultIsIndependentOfTheTilingAndLabelsStayCorrect) {
  const std::string folder = FreshTestFolder("tiled");
  const TinyScene scene = WriteTinyScene(folder);
  std::string untiled;
  JobSettings settings;
  // Images of 160 pixels are too small for level 2.
  settings.method_settings.levels = {1, 0};
  settings.method_settings.iterations = {8, 8};
  for (const int tiles : {1, 5}) {
    settings.tiles = tiles;
    const auto tasks = RunLine(folder, folder + "/work" + std::to_string(tiles), settings);
    ASSERT_TRUE(tasks.ok()) << tasks.status();
    const std::string path = tasks->back().output_dir + "/" + kMeshFile;
    const auto city = ReadCity(CityTaskOf(*tasks).output_dir + "/" + kCityFile);
    const auto result = ReadPly(path);
    ASSERT_TRUE(city.ok() && result.ok());
    EXPECT_EQ(result->mesh.faces.size(), city->mesh.faces.size());
    if (tiles == 1) {
      untiled = ReadText(path);
      // The start is the ground truth.
      int64_t wrong = 0;
      const size_t faces = result->mesh.faces.size();
      for (size_t f = 0; f < faces; ++f) wrong += result->mesh.labels[f] != city->mesh.labels[f];
      EXPECT_LT(wrong, static_cast<int64_t>(faces / 25));
    }
    EXPECT_TRUE(ReadText(path) == untiled) << tiles << " tiles";
    const nlohmann::json report = nlohmann::json::parse(ReadText(tasks->back().output_dir + "/" + kReportFile));
    EXPECT_EQ(report.at("tiles").size(), static_cast<size_t>(tiles));
    EXPECT_EQ(report.at("output").at("faces").get<size_t>(), city->mesh.faces.size());
    EXPECT_EQ(CountTasks(*tasks, "refine"), tiles == 1 ? 2 : 0) << "one of the coarse levels, one of the finest";
    const int64_t steps = static_cast<int64_t>(RefineStepsOf("tessera", 0, settings.method_settings).size());
    EXPECT_EQ(CountTasks(*tasks, "measure"), tiles == 1 ? 0 : steps * tiles);
    EXPECT_EQ(CountTasks(*tasks, "solve"), CountTasks(*tasks, "measure"));
  }
}

TEST(Line, FacesDifferFromTheCityOnlyByFlippedEdges) {
  const std::string folder = FreshTestFolder("flips");
  WriteTinyScene(folder);
  std::vector<TriangleMesh> results, cities;
  for (const bool flips : {false, true}) {
    JobSettings settings = {.tiles = 2, .rounds = 1};
    settings.method_settings.levels = {1, 0};
    settings.method_settings.iterations = {4, 4};
    if (!flips) settings.method_settings.flip_edges = false;
    const auto tasks = RunLine(folder, folder + (flips ? "/flipped" : "/plain"), settings);
    ASSERT_TRUE(tasks.ok()) << tasks.status();
    const auto city = ReadCity(CityTaskOf(*tasks).output_dir + "/" + kCityFile);
    const auto result = ReadPly(tasks->back().output_dir + "/" + kMeshFile);
    ASSERT_TRUE(city.ok() && result.ok());
    cities.push_back(city->mesh);
    results.push_back(result->mesh);
  }
  EXPECT_EQ(results[0].faces, cities[0].faces);
  EXPECT_EQ(results[0].vertices, results[1].vertices);
  EXPECT_EQ(results[0].labels, results[1].labels);
  size_t changed = 0;
  for (size_t f = 0; f < results[1].faces.size(); ++f) changed += results[1].faces[f] != results[0].faces[f];
  EXPECT_GT(changed, results[1].faces.size() / 100);
  const auto defects = CheckMesh(results[1]);
  ASSERT_TRUE(defects.ok());
  EXPECT_TRUE(defects->IsClean());
}

TEST(Line, TwoRoundsAreIndependentOfTheTiling) {
  const std::string folder = FreshTestFolder("exchange");
  WriteTinyScene(folder);
  std::vector<std::string> meshes;
  for (const int tiles : {1, 4}) {
    JobSettings settings = {.tiles = tiles, .rounds = 2};
    settings.method_settings.levels = {1, 0};
    settings.method_settings.iterations = {4, 4};
    meshes.push_back(ReadText(RunScene(folder, "work" + std::to_string(tiles), settings) + "/" + kMeshFile));
  }
  EXPECT_TRUE(meshes[0] == meshes[1]);
}

// The tiles' files contain each face of the result once, at the result's positions byte for byte.
TEST(Line, TileFilesPartitionTheMesh) {
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

TEST(Line, ResultIsIndependentOfThreads) {
  const std::string folder = FreshTestFolder("threads");
  WriteTinyScene(folder);
  std::string meshes[2], reports[2];
  for (const int threads : {1, 3}) {
    const ThreadLimit limit(threads);
    const std::string out = RunScene(folder, "work" + std::to_string(threads), {.tiles = 4});
    meshes[threads / 2] = *ReadFile(out + "/" + kMeshFile);
    reports[threads / 2] = *ReadFile(out + "/" + kReportFile);
  }
  EXPECT_EQ(meshes[0], meshes[1]);
  EXPECT_EQ(reports[0], reports[1]);
}

TEST(Line, MissingLabelsAreDerivedFromLikelihoods) {
  TinySceneOptions options;
  options.labels = false;
  const std::string folder = FreshTestFolder("unlabelled");
  const TinyScene scene = WriteTinyScene(folder, options);
  const auto result = ReadPly(RunScene(folder, "work", {.tiles = 2}) + "/" + kMeshFile);
  ASSERT_TRUE(result.ok());
  ASSERT_EQ(result->mesh.labels.size(), result->mesh.faces.size());
  for (const int32_t label : result->mesh.labels) {
    EXPECT_GE(label, 0);
    EXPECT_LT(label, 3);
  }
}

TEST(Line, LabelsArePreservedWithoutLikelihoods) {
  TinySceneOptions options;
  options.likelihoods = TinySceneOptions::Likelihoods::kNone;
  const std::string folder = FreshTestFolder("no_likelihoods");
  WriteTinyScene(folder, options);
  const auto tasks = RunLine(folder, folder + "/work", {.tiles = 3});
  ASSERT_TRUE(tasks.ok()) << tasks.status();
  const auto city = ReadCity(CityTaskOf(*tasks).output_dir + "/" + kCityFile);
  const auto result = ReadPly(tasks->back().output_dir + "/" + kMeshFile);
  ASSERT_TRUE(city.ok() && result.ok());
  EXPECT_EQ(result->mesh.labels, city->mesh.labels);
}

TEST(Line, OneClassWithoutLabelsAndLikelihoods) {
  TinySceneOptions options;
  options.likelihoods = TinySceneOptions::Likelihoods::kNone;
  options.labels = false;
  const std::string folder = FreshTestFolder("one_class");
  WriteTinyScene(folder, options);
  const auto result = ReadPly(RunScene(folder, "work", {.tiles = 2}) + "/" + kMeshFile);
  ASSERT_TRUE(result.ok()) << result.status();
  for (const int32_t label : result->mesh.labels) EXPECT_EQ(label, 0);
}

std::string RunMethod(const std::string& folder, const std::string& method) {
  JobSettings settings;
  settings.tiles = 2;
  settings.rounds = 2;
  settings.method = method;
  settings.method_settings.levels = {0};  // more would split the faces of `tessera` again
  settings.method_settings.iterations = {4};
  settings.method_settings.flip_edges = true;  // not the default of every method
  const auto tasks = RunLine(folder, folder + "/" + method, settings);
  EXPECT_TRUE(tasks.ok()) << tasks.status();
  return tasks.ok() ? tasks->back().output_dir + "/" + kMeshFile : "";
}

TEST(Line, OneClassEqualsTheBaselineMethod) {
  TinySceneOptions options;
  options.likelihoods = TinySceneOptions::Likelihoods::kNone;
  options.labels = false;
  const std::string folder = FreshTestFolder("one_class_methods");
  WriteTinyScene(folder, options);
  const auto ours = ReadFile(RunMethod(folder, "tessera")), baseline = ReadFile(RunMethod(folder, "baseline"));
  ASSERT_TRUE(ours.ok() && baseline.ok());
  EXPECT_EQ(*ours, *baseline);
}

TEST(Line, LabelsOnlyRequiresLikelihoods) {
  TinySceneOptions options;
  options.likelihoods = TinySceneOptions::Likelihoods::kNone;
  const std::string folder = FreshTestFolder("labels_alone");
  WriteTinyScene(folder, options);
  for (const int tiles : {1, 4}) {
    JobSettings settings = {.tiles = tiles};
    settings.method = "labels";
    const Status status = RunLine(folder, folder + "/work" + std::to_string(tiles), settings).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << tiles;
    EXPECT_NE(std::string(status.message()).find("found no likelihoods of two or more classes"), std::string::npos)
        << status;
  }
}

TEST(Line, UnusedClassChangesNothing) {
  MeshContent results[2];
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

TEST(Line, AllSceneErrorsAreReportedTogether) {
  const std::string folder = FreshTestFolder("faults");
  const TinyScene scene = WriteTinyScene(folder);
  const auto tasks = RunLine(folder, folder + "/good", {.tiles = 1}, StandStill);
  ASSERT_TRUE(tasks.ok()) << tasks.status();
  // Files change after the plan was made.
  WriteText(folder + "/mesh.ply", "not a mesh");
  WriteText(folder + "/images/" + scene.image_names[0], "not an image");
  const TaskRequest request = {"ingest", "{}", IngestOf(*tasks).output_dir + "/../in", FreshTestFolder("faults_out")};
  const Status status = RunTask(request, {}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_NE(std::string(status.message()).find("mesh.ply"), std::string::npos) << status;
  EXPECT_NE(std::string(status.message()).find(scene.image_names[0]), std::string::npos) << status;
}

// The report of the refine task of an untiled run.
nlohmann::json RefineStats(const std::string& folder, const std::string& work, JobSettings settings) {
  settings.tiles = 1;
  const auto tasks = RunLine(folder, folder + "/" + work, settings);
  EXPECT_TRUE(tasks.ok()) << tasks.status();
  for (const LineTask& task : *tasks) {
    if (task.planned.kind == "refine") return nlohmann::json::parse(task.outcome.stats);
  }
  return {};
}

// Number of warped pixels over all measure tasks of two tiles.
int64_t WarpedPixels(const std::string& folder, const std::string& work, JobSettings settings) {
  settings.tiles = 2;
  const auto tasks = RunLine(folder, folder + "/" + work, settings);
  EXPECT_TRUE(tasks.ok()) << tasks.status();
  int64_t pixels = 0;
  for (const LineTask& task : *tasks) {
    if (task.planned.kind == "measure") {
      pixels += nlohmann::json::parse(task.outcome.stats).value("warped_pixels", int64_t{0});
    }
  }
  return pixels;
}

// The border trust measured by ingest affects the contour term; without trustworthy likelihoods the term has no
// effect.
TEST(Line, BorderTrustAffectsContours) {
  const std::string folder = FreshTestFolder("silhouettes");
  SynthesizeStrip(folder, 1);
  JobSettings with, without;
  with.method_settings.levels = without.method_settings.levels = {1};
  with.method_settings.iterations = without.method_settings.iterations = {2};
  without.method_settings.contour = 0;
  const auto mesh = [&](const std::string& work, const JobSettings& settings) {
    return ReadFile(RunScene(folder, work, settings) + "/" + kMeshFile).value();
  };
  EXPECT_NE(mesh("with", with), mesh("without", without));
  for (const auto& file : std::filesystem::directory_iterator(folder + "/likelihoods")) {
    LabelImage unknown(120, 90, 1, 255);
    ASSERT_TRUE(WritePng(std::filesystem::path(file.path()).replace_extension(".png").string(), unknown).ok());
    std::filesystem::remove(file.path());
  }
  EXPECT_EQ(mesh("unknown-with", with), mesh("unknown-without", without));
}

TEST(Line, MethodAndSettingsTakeEffect) {
  const std::string folder = FreshTestFolder("methods");
  WriteTinyScene(folder);
  JobSettings settings;
  settings.method_settings.levels = {1};
  settings.method_settings.iterations = {2};
  const int64_t pixels = WarpedPixels(folder, "pixels", settings);
  EXPECT_GT(pixels, 0);
  settings.method_settings.iterations = {4};
  EXPECT_GT(WarpedPixels(folder, "longer", settings), pixels);
  settings.method_settings.iterations = {2};
  settings.method_settings.partners = 1;
  EXPECT_LT(WarpedPixels(folder, "fewer", settings), pixels);
  settings.method_settings.partners.reset();
  settings.method_settings.views_per_direction = 1;
  EXPECT_LE(WarpedPixels(folder, "fewer_views", settings), pixels);
  settings.method_settings.views_per_direction.reset();

  const nlohmann::json ours = RefineStats(folder, "ours", settings);
  EXPECT_EQ(ours.at("rounds").size(), 2u);
  EXPECT_TRUE(ours.contains("labels_first"));
  settings.method = "paper";
  const nlohmann::json paper = RefineStats(folder, "paper", settings);
  EXPECT_EQ(paper.at("rounds").size(), 5u);
  EXPECT_FALSE(paper.contains("labels_first")) << "labelling first is only needed without labels";
  // Another label energy: other labels are best.
  EXPECT_NE(paper.at("rounds").at(0).at("label_changes"), ours.at("rounds").at(0).at("label_changes"));
}

TEST(Line, UnlabelledStartIsLabelledBeforeTheGeometrySteps) {
  TinySceneOptions options;
  options.labels = false;
  const std::string folder = FreshTestFolder("unlabelled_methods");
  WriteTinyScene(folder, options);
  JobSettings settings;
  settings.method_settings.levels = {1};
  settings.method_settings.iterations = {1};
  EXPECT_TRUE(RefineStats(folder, "ours", settings).contains("labels_first"));
  settings.method = "baseline";
  EXPECT_FALSE(RefineStats(folder, "baseline", settings).contains("labels_first"));
}

// Tasks that inspect some images each change neither survey nor mesh.
TEST(Line, InspectedImagesGiveTheSameSurvey) {
  for (const std::string& classifier : {std::string(), std::string(kDefaultClassifier)}) {
    const std::string in = FreshTestFolder("inspected"), scene = in + "/" + kSceneFolder, alone = in + "/alone";
    WriteTinyScene(scene, {.tower = true});
    std::filesystem::remove(scene + "/colmap/points3D.txt");  // which jobs do not read
    IngestParameters parameters;
    parameters.coarse_faces = true;  // as the default method
    if (!classifier.empty()) {
      parameters.classify = parameters.by_default_rule = true;
      std::filesystem::remove_all(scene + "/likelihoods");
      for (int view = 0; view < 9; ++view) {  // enough images for several tasks
        std::filesystem::create_directories(scene + "/masks");
        ASSERT_TRUE(WritePng(scene + "/masks/view" + std::to_string(view) + ".png", ByteImage(160, 120, 1, 255)).ok());
      }
    }
    ASSERT_TRUE(EnsureFolder(alone).ok());
    const auto whole = RunTask({"ingest", ToJson(parameters), in, alone}, {});
    ASSERT_TRUE(whole.ok()) << whole.status();
    int inspected = 0;
    std::string made;  // by ingest of the line
    const auto runner = [&](const TaskRequest& request) -> StatusOr<TaskOutcome> {
      if (request.kind != kInspectKind && request.kind != kIngestKind) return absl::CancelledError("far enough");
      inspected += request.kind == kInspectKind;
      made = request.output_dir;
      return RunTask(request, {});
    };
    RunLine(scene, in + "/work", {.classifier = classifier}, runner).IgnoreError();
    EXPECT_GT(inspected, 1);
    for (const char* file : {kSurveyFile, kCityFile, kPlainSurveyFile}) {
      EXPECT_TRUE(ReadText(alone + "/" + file) == ReadText(made + "/" + file)) << file;
    }
  }
}

}  // namespace
}  // namespace tessera
