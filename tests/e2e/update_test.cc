// Updates: a new flight over part of the city, with the real executables.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "common/meshio/ply.h"
#include "tests/e2e/programs.h"

namespace tessera::e2e {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::HasSubstr;

void Write(const std::string& path, const std::string& content) {
  fs::create_directories(fs::path(path).parent_path());
  std::ofstream(path, std::ios::binary) << content;
}

// A copy of the street whose files may be changed.
std::string CopyOfCity(const std::string& to) {
  fs::copy(Street(), to, fs::copy_options::recursive);
  return to;
}

// Calls edit(words) for the line of each image in the camera model: IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME.
// Those for which it gives false are dropped.
template <class Edit>
void EditCameras(const std::string& scene, const Edit& edit) {
  const std::string path = scene + "/colmap/images.txt";
  std::istringstream in(Content(path));
  std::string out, line;
  bool keep = true, points = false;
  while (std::getline(in, line)) {
    if (line.starts_with("#")) continue;
    if (points) {
      if (keep) out += line + "\n";
      points = false;
      continue;
    }
    std::istringstream words(line);
    std::vector<std::string> split{std::istream_iterator<std::string>(words), {}};
    keep = edit(split);
    points = true;
    if (!keep) continue;
    for (const std::string& word : split) out += word + " ";
    out += "\n";
  }
  Write(path, out);
}

class UpdateTest : public testing::Test {
 protected:
  UpdateTest() : folder_(TempFolder::Create(testing::TempDir()).value()) {}

  std::string Path(const std::string& name) const { return folder_.path() + "/" + name; }

  // The finished base, a copy of its own with its state.
  std::string Base() {
    if (!fs::exists(Path("base"))) CopyStreetResult(Path("base"));
    return Path("base");
  }

  Outcome Update(const std::string& scene, const std::string& out, const std::vector<std::string>& more = {},
                 const std::string& base = "") {
    std::vector<std::string> arguments = {"run", scene, "--base", base.empty() ? Base() : base, "--out", Path(out)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return Tessera(folder_.path(), arguments);
  }

  json Json(const std::string& name) const { return json::parse(Content(Path(name))); }
  // About as many: a job splits faces again where its coarse levels have moved them, an update where the mesh has them.
  void ExpectAsManyFaces(const std::string& out, const std::string& as) const {
    const double now = Json(out + "/report.json")["output"]["faces"], of = Json(as + "/report.json")["output"]["faces"];
    EXPECT_NEAR(now, of, 0.05 * of);
  }
  // Kinds of the tasks that ran.
  std::multiset<std::string> Ran(const std::string& out) const {
    std::multiset<std::string> kinds;
    const json job = Json(out + "/job.json");
    for (const json& task : job["tasks"]) {
      if (task["attempts"] > 0) kinds.insert(task["kind"].get<std::string>());
    }
    return kinds;
  }
  // Of each face of the result; empty if it has no such property.
  std::vector<bool> Outdated(const std::string& out) const {
    const std::string mesh = Mesh(out), faces = "element face ";
    const size_t begin = mesh.find("end_header\n");
    const std::string header = mesh.substr(0, begin);
    if (!header.ends_with("property uchar outdated\n")) return {};
    std::vector<bool> outdated(std::stoul(header.substr(header.find(faces) + faces.size())));
    const size_t bytes = 1 + 3 * 4 + 4 + 3 + 4 + 4 + 1;  // corners, label, colour, confidence, input face, and it
    for (size_t f = 0; f < outdated.size(); ++f)
      outdated[f] = mesh[mesh.size() - 1 - (outdated.size() - 1 - f) * bytes];
    return outdated;
  }
  std::string Mesh(const std::string& out) const { return Content(Path(out) + "/mesh.ply"); }

  // Of each tile, whether it was redone; checks that the tiles' meshes say so too.
  std::vector<bool> Redone(const std::string& out) {
    std::vector<bool> redone;
    const json update = Json(out + "/update.json"), index = Json(out + "/tiles/index.json");
    for (size_t t = 0; t < update["tiles"].size(); ++t) {
      redone.push_back(update["tiles"][t]["redone"]);
      const std::string file = index["tiles"][t]["file"];
      const bool same = Content(Path(out) + "/tiles/" + file) == Content(Base() + "/tiles/" + file);
      if (!redone.back()) {
        EXPECT_TRUE(same) << "tile " << t << " was to be kept";
      }
    }
    EXPECT_EQ(Json(out + "/report.json")["seams"]["different"], 0);
    return redone;
  }

  TempFolder folder_;
};

TEST_F(UpdateTest, UpdateWithTheSameSceneRunsNoTask) {
  const Outcome outcome = Update(Street(), "same");
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_EQ(Ran("same"), (std::multiset<std::string>{"update"}));
  EXPECT_TRUE(Mesh("same") == Content(Base() + "/mesh.ply"));
  EXPECT_EQ(Json("same/update.json")["tiles_redone"], 0);
}

TEST_F(UpdateTest, RenamedReencodedAndPoseJitteredImagesRunNoTask) {
  const std::string scene = CopyOfCity(Path("other"));
  int count = 0;
  EditCameras(scene, [&](std::vector<std::string>& words) {
    const fs::path old_name = words[9];
    const std::string name = "flight/" + std::to_string(++count) + old_name.extension().string();
    fs::create_directories(scene + "/images/flight");
    fs::create_directories(scene + "/likelihoods/flight");
    fs::rename(scene + "/images/" + words[9], scene + "/images/" + name);
    for (const auto& file : fs::directory_iterator(scene + "/likelihoods")) {
      if (file.path().stem() != old_name.stem()) continue;
      fs::rename(file.path(),
                 scene + "/likelihoods/flight/" + std::to_string(count) + file.path().extension().string());
    }
    words[9] = name;
    // Other bytes, the same pixels: readers stop at the end of the picture.
    if (count % 2 == 0) std::ofstream(scene + "/images/" + name, std::ios::app | std::ios::binary) << "a comment";
    if (count % 3 == 0) words[5] = std::to_string(std::stod(words[5]) + 1e-4);  // far below a tenth of a pixel
    return true;
  });
  json file = json::parse(Content(scene + "/scene.json"));
  file["flights"] = json::array({{{"name", "spring again"}, {"date", "2026-06-01"}, {"images", {"*"}}}});
  Write(scene + "/scene.json", file.dump());
  const Outcome outcome = Update(scene, "renamed");
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_THAT(outcome.output, HasSubstr("poses differ from those of the base job by less than 0.1 px"));
  auto ran = Ran("renamed");
  ran.erase("inspect");  // only their pixels tell that the images are known
  EXPECT_EQ(ran, (std::multiset<std::string>{"update", "publish"})) << "the report tells of the snapped poses";
  EXPECT_TRUE(Mesh("renamed") == Content(Base() + "/mesh.ply"));
}

TEST_F(UpdateTest, NewFlightRefinesOnlyTilesThatItSees) {
  const Outcome plan = Tessera(folder_.path(), {"plan", NextFlight(), "--base", Base(), "--json", Path("plan.json"),
                                                "--map", Path("map.svg"), "--price-per-core-hour", "1"});
  ASSERT_EQ(plan.exit_code, 0) << plan.output;
  EXPECT_THAT(plan.output, HasSubstr("image seen"));
  EXPECT_THAT(Content(Path("map.svg")), HasSubstr("</svg>"));
  const Outcome outcome = Update(NextFlight(), "next");
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_EQ(Json("plan.json"), Json("next/update.json")) << "the plan is what is done";
  EXPECT_GT(Json("next/changes.json")["measured_area_m2"], 500) << "the flight's part of the street";
  EXPECT_EQ(Json("next/changes.geojson")["type"], "FeatureCollection");
  EXPECT_THAT(Content(Path("next/changes.png")).substr(1, 3), testing::Eq("PNG"));
  const std::vector<bool> redone = Redone("next");
  const auto count = std::count(redone.begin(), redone.end(), true);
  EXPECT_GT(count, 0);
  EXPECT_LT(count, static_cast<int64_t>(redone.size()));
  std::set<int> measured;
  const json job = Json("next/job.json");
  for (const json& task : job["tasks"]) {
    if (task["kind"] == "measure") measured.insert(task["tile"].get<int>());
  }
  EXPECT_EQ(static_cast<int64_t>(measured.size()), count);
  EXPECT_FALSE(Mesh("next") == Content(Base() + "/mesh.ply"));
  // Once more, beside the first result: all of it is known.
  ASSERT_EQ(Update(NextFlight(), "again").exit_code, 0);
  EXPECT_EQ(Ran("again").size(), 0u);
  EXPECT_TRUE(Mesh("again") == Mesh("next"));
  // An update of the update: the whole scene as it was, without the flight.
  const Outcome back = Update(Street(), "back", {}, Path("next"));
  ASSERT_EQ(back.exit_code, 0) << back.output;
  EXPECT_THAT(Content(Path("back/update.json")), HasSubstr("image withdrawn"));
  EXPECT_EQ(Json("back/update.json")["tiles_redone"], count);
}

TEST_F(UpdateTest, OutdatedFacesStayFlagged) {
  const auto fly = [&](const std::string& name, const std::vector<std::string>& more) {
    std::vector<std::string> words = {"synth", Path(name), "--change", Street(), "--quiet"};
    words.insert(words.end(), more.begin(), more.end());
    const Outcome outcome = Tessera(folder_.path(), words);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
    return Path(name);
  };
  const Outcome outcome = Update(fly("changed", {"--part", "0,0,0.4,1"}), "later");
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_THAT(outcome.output, HasSubstr("need a new coarse mesh"));
  const std::vector<bool> later = Outdated("later");
  const auto count = std::count(later.begin(), later.end(), true);
  const json changes = Json("later/changes.json"), index = Json("later/tiles/index.json");
  int64_t of_areas = 0, of_tiles = 0;
  for (const json& area : changes["areas"]) {
    EXPECT_EQ(area.contains("new_mesh"), area["followed"] == false);
    if (area.contains("new_mesh")) of_areas += area["new_mesh"]["outdated_faces"].get<int64_t>();
  }
  for (const json& tile : index["tiles"]) of_tiles += tile["outdated_faces"].get<int64_t>();
  EXPECT_GT(count, 0);
  EXPECT_LT(count, static_cast<int64_t>(later.size() / 4));
  EXPECT_EQ(of_areas, count);
  EXPECT_EQ(of_tiles, count);
  EXPECT_FALSE(fs::exists(Path("later/outdated.arrays")));
  Redone("later");  // tiles that were kept have their bytes
  // Nobody looks, then others look elsewhere: what was found stays.
  ASSERT_EQ(Update(Path("changed"), "again", {}, Path("later")).exit_code, 0);
  EXPECT_TRUE(Mesh("again") == Mesh("later"));
  ASSERT_EQ(Update(fly("elsewhere", {"--unchanged", "--part", "0.9,0,1,1"}), "next", {}, Path("later")).exit_code, 0);
  const std::vector<bool> next = Outdated("next");
  ASSERT_EQ(next.size(), later.size());
  for (size_t f = 0; f < later.size(); ++f) ASSERT_LE(later[f], next[f]) << f;
}

TEST_F(UpdateTest, WithdrawnImageRefinesTilesThatUsedIt) {
  const std::string scene = CopyOfCity(Path("fewer"));
  std::string dropped;
  EditCameras(scene, [&](const std::vector<std::string>& words) {
    if (!dropped.empty()) return true;
    dropped = words[9];
    return false;
  });
  fs::remove(scene + "/images/" + dropped);
  const Outcome outcome = Update(scene, "fewer-out");
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  const std::vector<bool> redone = Redone("fewer-out");
  const auto count = std::count(redone.begin(), redone.end(), true);
  EXPECT_GT(count, 0);
  EXPECT_LT(count, static_cast<int64_t>(redone.size()));
  const json update = Json("fewer-out/update.json");
  for (const json& tile : update["tiles"]) {
    for (const json& why : tile["why"]) {
      if (why["reason"] == "image withdrawn") {
        EXPECT_EQ(why["images"], json::array({dropped}));
      }
    }
  }
}

TEST_F(UpdateTest, FromScratchGivesTheSameBytesForAnyTiling) {
  const Outcome scratch = Update(NextFlight(), "scratch", {"--from-scratch"});
  ASSERT_EQ(scratch.exit_code, 0) << scratch.output;
  EXPECT_THAT(scratch.output, HasSubstr("all are refined from the start mesh again"));
  EXPECT_EQ(Json("scratch/report.json")["seams"]["different"], 0);
  const Outcome one = Tessera(folder_.path(), {"run", Street(), "--tiles", "1", "--out", Path("one")});
  ASSERT_EQ(one.exit_code, 0) << one.output;
  ASSERT_EQ(Update(NextFlight(), "whole", {"--from-scratch"}, Path("one")).exit_code, 0);
  EXPECT_TRUE(Mesh("scratch") == Mesh("whole"));
}

// The images of a flight are classified as those of the base were, and no other again.
TEST_F(UpdateTest, JobClassifiesImagesOfTheNewFlight) {
  fs::create_directory(Path("painted"));
  int painted = 0;
  for (const auto& entry : fs::directory_iterator(Street() + "/truth")) {
    if (entry.path().extension() == ".png" && painted++ < 4) {
      fs::copy_file(entry.path(), Path("painted") + "/" + entry.path().filename().string());
    }
  }
  ASSERT_EQ(Tessera(folder_.path(), {"classify", Street(), "--train", Path("painted"), "--out", Path("classified"),
                                     "--save-model", Path("model")})
                .exit_code,
            0);
  const auto base = [&](const char* name, const char* tiles) {
    return Tessera(folder_.path(), {"run", Street(), "--classifier", Path("model"), "--tiles", tiles, "--rounds", "1",
                                    "--levels", "1", "--iterations", "2", "--out", Path(name)});
  };
  const Outcome first = base("four", "4"), other = base("one", "1");
  ASSERT_TRUE(first.exit_code == 0 && other.exit_code == 0) << first.output << other.output;
  EXPECT_TRUE(Mesh("four") == Mesh("one"));
  // The job has kept it; another is not what the base went by.
  ASSERT_EQ(Tessera(folder_.path(), {"classify", Street(), "--train", Path("painted"), "--out", Path("classified"),
                                     "--seed", "2", "--save-model", Path("model")})
                .exit_code,
            0);
  const Outcome another = Update(NextFlight(), "another", {"--classifier", Path("model")}, Path("four"));
  EXPECT_EQ(another.exit_code, 3) << another.output;
  EXPECT_THAT(another.output, HasSubstr("an update keeps that of its base"));
  fs::remove(Path("model"));
  const auto images = [](const std::string& scene) {
    return std::distance(fs::directory_iterator(scene + "/images"), fs::directory_iterator());
  };

  const Outcome flight = Update(NextFlight(), "next", {}, Path("four"));
  ASSERT_EQ(flight.exit_code, 0) << flight.output;
  const std::multiset<std::string> ran = Ran("next");
  EXPECT_GT(ran.count("classify"), 0u);
  EXPECT_LE(ran.count("classify"), static_cast<size_t>(images(NextFlight())));
  EXPECT_EQ(ran.count("borders"), 0u) << "the base's";
  EXPECT_GT(ran.count("compare"), 0u);
  EXPECT_EQ(Json("next/report.json")["seams"]["different"], 0);
  // As far as it is stored nothing is made twice, in an update of the update either.
  ASSERT_EQ(Update(NextFlight(), "again", {}, Path("next")).exit_code, 0);
  EXPECT_EQ(Ran("again").count("classify"), 0u);
  EXPECT_TRUE(Mesh("again") == Mesh("next"));

  ASSERT_EQ(Update(NextFlight(), "whole4", {"--from-scratch"}, Path("four")).exit_code, 0);
  ASSERT_EQ(Update(NextFlight(), "whole1", {"--from-scratch"}, Path("one")).exit_code, 0);
  EXPECT_TRUE(Mesh("whole4") == Mesh("whole1"));
}

TEST_F(UpdateTest, KilledCoordinatorResumesConcurrentUpdates) {
  ASSERT_EQ(Update(NextFlight(), "next").exit_code, 0);
  Cluster cluster(Path("cluster"));
  cluster.AddWorker();
  cluster.AddWorker();
  const v1::Job base = cluster.Await(cluster.Submit(Street(), 8).name());
  ASSERT_EQ(base.state(), v1::JOB_STATE_SUCCEEDED) << base.error();
  // The same flight, and the whole scene as it was: two updates of one base at once.
  const std::string flight = cluster.Submit(NextFlight(), 0, "a", base.name()).name();
  const std::string same = cluster.Submit(Street(), 0, "b", base.name()).name();
  const auto solved = [&] {
    for (const v1::Task& task : cluster.Tasks(flight)) {
      if (task.kind() == "solve" && task.state() == v1::TASK_STATE_SUCCEEDED) return true;
    }
    return false;
  };
  ASSERT_TRUE(WaitUntil(solved));
  cluster.coordinator().Kill();
  cluster.StartCoordinator();
  for (const std::string& job : {flight, same}) {
    const v1::Job done = cluster.Await(job);
    EXPECT_EQ(done.state(), v1::JOB_STATE_SUCCEEDED) << done.error();
  }
  EXPECT_TRUE(Content(cluster.Fetch(flight) + "/mesh.ply") == Mesh("next"));
  EXPECT_TRUE(Content(cluster.Fetch(same) + "/mesh.ply") == Content(Base() + "/mesh.ply"));
}

TEST_F(UpdateTest, ChangedMeshRefinesOnlyChangedTiles) {
  // The street's east end is a metre higher, and its faces come in another order.
  const std::string scene = CopyOfCity(Path("scene"));
  MeshContent mesh = *ReadPly(scene + "/mesh.ply");
  double east_m = mesh.mesh.vertices[0].x();
  for (const Eigen::Vector3d& p : mesh.mesh.vertices) east_m = std::max(east_m, p.x());
  size_t raised = 0;
  for (Eigen::Vector3d& p : mesh.mesh.vertices) {
    if (p.x() < east_m - 12) continue;
    p.z() += 1;
    ++raised;
  }
  ASSERT_GT(raised, 10u);
  ASSERT_LT(raised, mesh.mesh.vertices.size() / 4);
  std::reverse(mesh.mesh.faces.begin(), mesh.mesh.faces.end());
  std::reverse(mesh.mesh.labels.begin(), mesh.mesh.labels.end());
  ASSERT_TRUE(WritePly(scene + "/mesh.ply", mesh.mesh).ok());
  const Outcome outcome = Update(scene, "raised");
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_THAT(Content(Path("raised/update.json")), HasSubstr("mesh changed"));
  const std::vector<bool> redone = Redone("raised");
  EXPECT_THAT(redone, testing::Contains(true));
  EXPECT_THAT(redone, testing::Contains(false));
  const MeshContent result = *ReadPly(Path("raised/mesh.ply"));
  EXPECT_EQ(Json("raised/report.json")["output"]["faces"], result.mesh.faces.size());
  // The old mesh again: an update of the update.
  const Outcome back = Update(Street(), "back", {}, Path("raised"));
  ASSERT_EQ(back.exit_code, 0) << back.output;
  EXPECT_EQ(Json("back/report.json")["seams"]["different"], 0);
  ExpectAsManyFaces("back", "base");
}

TEST_F(UpdateTest, TileWithoutFacesIsRemoved) {
  // Without the faces that reach into the first tile.
  const json index = json::parse(Content(Base() + "/tiles/index.json")), core = index["tiles"][0]["core_m"];
  const double west_m = index["local_origin_in_scene"][0], south_m = index["local_origin_in_scene"][1];
  const Eigen::AlignedBox2d ground(Eigen::Vector2d(core[0].get<double>() + west_m, core[1].get<double>() + south_m),
                                   Eigen::Vector2d(core[2].get<double>() + west_m, core[3].get<double>() + south_m));
  const std::string scene = CopyOfCity(Path("scene"));
  const TriangleMesh street = ReadPly(scene + "/mesh.ply")->mesh;
  TriangleMesh rest = {street.vertices, {}, {}};
  for (size_t f = 0; f < street.faces.size(); ++f) {
    Eigen::AlignedBox2d box;
    for (int k = 0; k < 3; ++k) box.extend(street.Corner(f, k).head<2>());
    if (box.intersects(ground)) continue;
    rest.faces.push_back(street.faces[f]);
    rest.labels.push_back(street.labels[f]);
  }
  ASSERT_LT(rest.faces.size(), street.faces.size());
  ASSERT_GT(rest.faces.size(), street.faces.size() / 2);
  ASSERT_TRUE(WritePly(scene + "/mesh.ply", rest).ok());
  const Outcome outcome = Update(scene, "gone");
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_THAT(outcome.output, HasSubstr("1 removed: the mesh has no face in them"));
  EXPECT_EQ(Json("gone/update.json")["tiles_gone"], json::array({0}));
  EXPECT_EQ(Json("gone/tiles/index.json")["tiles"].size(), index["tiles"].size() - 1);
  EXPECT_FALSE(fs::exists(Path("gone/tiles/" + index["tiles"][0]["file"].get<std::string>())));
  EXPECT_THAT(Redone("gone"), testing::Contains(false));
  EXPECT_EQ(Json("gone/report.json")["output"]["faces"], ReadPly(Path("gone/mesh.ply"))->mesh.faces.size());
  // The old mesh again: other tiles have that ground.
  const Outcome back = Update(Street(), "back", {}, Path("gone"));
  ASSERT_EQ(back.exit_code, 0) << back.output;
  EXPECT_EQ(Json("back/report.json")["seams"]["different"], 0);
  ExpectAsManyFaces("back", "base");
  for (const json& tile : Json("back/tiles/index.json")["tiles"]) EXPECT_NE(tile["tile"], 0) << "a number given twice";
}

TEST_F(UpdateTest, ImpossibleUpdatesAreRefusedWithAdvice) {
  const auto expect = [&](const Outcome& outcome, const std::string& words) {
    EXPECT_NE(outcome.exit_code, 0);
    EXPECT_THAT(outcome.output, HasSubstr(words));
  };
  expect(Update(Street(), "a", {}, Path("nowhere")), "expected a folder that `tessera run --out` wrote");
  expect(Update(Street(), "b", {"--withdraw", "autumn"}),
         "found flight 'autumn', expected a flight of the base job: 'spring'");
  expect(Update(Street(), "c", {"--tiles", "4"}), "an update inherits it from its base job");
  expect(Update(Street(), "d", {"--withdraw", "spring"}), "all images of the base job are withdrawn");
  expect(Update(Street(), "e", {"--from-scratch", "--max-price", "1e-9", "--price-per-core-hour", "1"}),
         "core-seconds, more than the");
  const std::string mesh = CopyOfCity(Path("mesh"));
  Write(mesh + "/mesh.ply", Content(mesh + "/mesh.ply") + std::string(100, ' '));
  expect(Update(mesh, "f"), "mesh.ply");
}

// The base has ended, and its tasks run again for what the update needs of them.
TEST_F(UpdateTest, LostResultsOfBaseJobAreRecomputed) {
  const auto blob = [&](const std::string& sha256) {
    return Base() + "/.tessera/data/blobs/" + sha256.substr(0, 2) + "/" + sha256;
  };
  const json job = json::parse(Content(Base() + "/job.json"));
  std::string state;
  for (const json& task : job["tasks"]) {
    const json& outputs = task["outputs"];
    if (outputs.contains("state.arrays")) state = outputs["state.arrays"]["sha256"];
    if (!outputs.contains("city.arrays")) continue;
    std::fstream survey(blob(outputs["survey.json"]["sha256"]), std::ios::in | std::ios::out);
    survey.put('[');
    const std::string city = blob(outputs["city.arrays"]["sha256"]);
    fs::resize_file(city, fs::file_size(city) / 2);
  }
  ASSERT_TRUE(fs::remove(blob(state)));
  const Outcome outcome = Update(Street(), "again");
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_EQ(Content(Path("again/mesh.ply")), Content(Base() + "/mesh.ply"));
}

}  // namespace
}  // namespace tessera::e2e
