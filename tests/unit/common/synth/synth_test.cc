#include "common/synth/synth.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

#include "common/base/parallel.h"
#include "common/base/random.h"
#include "common/geometry/ray_caster.h"
#include "common/imaging/image_io.h"
#include "common/meshio/ply.h"
#include "common/scene/scene.h"
#include "common/storage/files.h"
#include "common/synth/photos/flight.h"
#include "tests/unit/common/synth/all_files.h"

namespace tessera {
namespace {

SynthOptions Toy(uint64_t seed) {
  SynthOptions options;
  options.columns = options.rows = 1;
  options.seed = seed;
  options.gsd_m = 0.3;
  options.image_width_px = 320;
  options.image_height_px = 240;
  return options;
}

std::string OwnFolder() { return testing::TempDir() + "synth_test/"; }

// One toy city for all tests that only read it.
class SynthTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = OwnFolder() + "synth_toy";
    std::filesystem::remove_all(folder_);
    ThreadLimit limit(2);
    report_ = new StatusOr<SynthReport>(SynthesizeCity(Toy(11), folder_, {}));
    ASSERT_TRUE(report_->ok()) << report_->status();
  }
  static void TearDownTestSuite() {
    std::filesystem::remove_all(OwnFolder());
    delete report_;
  }

  static std::string folder_;
  static StatusOr<SynthReport>* report_;
};
std::string SynthTest::folder_;
StatusOr<SynthReport>* SynthTest::report_ = nullptr;

void ExpectDifficultyInRange(const SynthReport& report) {
  EXPECT_GE(report.start_accuracy_by_area, 0.82);
  EXPECT_LE(report.start_accuracy_by_area, 0.86);
  EXPECT_GE(report.likelihood_accuracy, 0.85);
  EXPECT_LE(report.likelihood_accuracy, 0.90);
}

TEST_F(SynthTest, IsDeterministicForAnyNumberOfThreads) {
  const std::string again = OwnFolder() + "again/synth_toy";  // the scene is named after its folder
  std::filesystem::remove_all(again);
  {
    ThreadLimit limit(1);
    ASSERT_TRUE(SynthesizeCity(Toy(11), again, {}).ok());
  }
  const auto first = AllFiles(folder_), second = AllFiles(again);
  ASSERT_GT(first.size(), 40u);
  ASSERT_EQ(first.size(), second.size());
  for (const auto& [name, bytes] : first) EXPECT_TRUE(second.count(name) && second.at(name) == bytes) << name;
  std::filesystem::remove_all(again);
}

TEST_F(SynthTest, AccuraciesAreInRangeForEverySeed) {
  ExpectDifficultyInRange(**report_);
  const std::string other = OwnFolder() + "synth_other";
  std::filesystem::remove_all(other);
  const auto report = SynthesizeCity(Toy(12), other, {});
  ASSERT_TRUE(report.ok()) << report.status();
  ExpectDifficultyInRange(*report);
  EXPECT_NE(*ReadFile(other + "/mesh.ply"), *ReadFile(folder_ + "/mesh.ply"));
  std::filesystem::remove_all(other);
}

TEST_F(SynthTest, TruthMatchesTheViews) {
  Warnings warnings;
  const auto scene = LoadScene(folder_, &warnings);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_THAT(warnings, testing::IsEmpty());
  EXPECT_EQ(static_cast<int64_t>(scene->views.size()), (*report_)->images);
  const auto truth = ReadPly(folder_ + "/truth/mesh.ply");
  ASSERT_TRUE(truth.ok()) << truth.status();
  const RayCaster caster(truth->mesh);
  Random random(1);
  int tried = 0, wrong = 0, named = 0;
  int64_t right = 0, all = 0;
  std::set<int> classes;
  for (const SceneView& view : scene->views) {
    const std::string stem = std::filesystem::path(view.name).stem().string();
    const auto labels = ReadLabelImage(folder_ + "/truth/" + stem + "_label.png");
    ASSERT_TRUE(labels.ok()) << labels.status();
    const auto likelihoods = ReadLikelihoods(folder_ + "/" + view.likelihood_path, 4, view.lens);
    ASSERT_TRUE(likelihoods.ok()) << likelihoods.status();
    for (int k = 0; k < 400; ++k) {
      const int x = static_cast<int>(random.Below(labels->width)), y = static_cast<int>(random.Below(labels->height));
      const RayHit hit = caster.Cast(view.camera.Centre(), view.camera.Ray(x + 0.5, y + 0.5));
      const int label = labels->at(x, y);
      ++tried;
      wrong += label != (hit.hit() ? truth->mesh.labels[hit.face] : 255);
      if (label == 255) continue;
      ++named;
      classes.insert(label);
    }
    for (int y = 0; y < labels->height; ++y) {
      for (int x = 0; x < labels->width; ++x) {
        const int label = labels->at(x, y);
        if (label == 255) continue;
        int best = 0;
        for (int c = 1; c < 4; ++c) best = likelihoods->at(x, y, c) > likelihoods->at(x, y, best) ? c : best;
        ++all;
        right += best == label;
      }
    }
  }
  EXPECT_LE(wrong, tried / 500);  // a ray along an edge may meet either face
  EXPECT_GT(named, tried / 3);
  EXPECT_EQ(classes.size(), 4u);
  EXPECT_NEAR(static_cast<double>(right) / static_cast<double>(all), (*report_)->likelihood_accuracy, 0.002);
}

TEST_F(SynthTest, StartMeshIsAnOrientedManifold) {
  const auto start = ReadPly(folder_ + "/mesh.ply");
  ASSERT_TRUE(start.ok()) << start.status();
  const TriangleMesh& mesh = start->mesh;
  EXPECT_EQ(static_cast<int64_t>(mesh.faces.size()), (*report_)->start_faces);
  std::set<std::pair<uint32_t, uint32_t>> directed;
  std::vector<std::map<uint32_t, uint32_t>> around(mesh.vertices.size());  // next[a] = b for each face (v, a, b)
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    EXPECT_GT(FaceArea(mesh, f), 1e-6);
    for (int k = 0; k < 3; ++k) {
      const uint32_t v = mesh.faces[f][k], a = mesh.faces[f][(k + 1) % 3], b = mesh.faces[f][(k + 2) % 3];
      EXPECT_TRUE(directed.insert({v, a}).second) << "an edge has two faces on one side";
      around[v][a] = b;
    }
  }
  for (const auto& next : around) {
    ASSERT_FALSE(next.empty());
    // Exactly one fan: all faces are reached from its first edge (for an open fan, the edge without a predecessor).
    std::set<uint32_t> ends;
    for (const auto& [a, b] : next) ends.insert(b);
    uint32_t start_edge = next.begin()->first;
    for (const auto& [a, b] : next) {
      if (!ends.count(a)) start_edge = a;
    }
    size_t faces = 0;
    for (auto place = next.find(start_edge); place != next.end() && faces < next.size();
         place = next.find(place->second))
      ++faces;
    EXPECT_EQ(faces, next.size());
  }
  // The ground faces up.
  double up = 0;
  for (size_t f = 0; f < mesh.faces.size(); ++f) up += FaceCross(mesh, f).z();
  EXPECT_GT(up, 0.0);
}

TEST_F(SynthTest, SparsePointsProjectOntoTheirObservations) {
  const auto scene = LoadScene(folder_, nullptr);
  ASSERT_TRUE(scene.ok()) << scene.status();
  std::ifstream points(folder_ + "/colmap/points3D.txt"), images(folder_ + "/colmap/images.txt");
  std::map<int, Eigen::Vector3d> position;
  std::string line;
  while (std::getline(points, line)) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream in(line);
    int id;
    Eigen::Vector3d p;
    in >> id >> p.x() >> p.y() >> p.z();
    position[id] = p;
  }
  ASSERT_GT(position.size(), 50u);
  int observations = 0;
  std::getline(images, line);
  while (std::getline(images, line)) {
    const std::string name = line.substr(line.rfind(' ') + 1);
    const auto view = std::find_if(scene->views.begin(), scene->views.end(),
                                   [&](const SceneView& other) { return other.name == name; });
    ASSERT_NE(view, scene->views.end()) << name;
    std::getline(images, line);
    std::istringstream in(line);
    double x, y;
    int id;
    while (in >> x >> y >> id) {
      const Eigen::Vector3d p = view->camera.Project(position.at(id));
      EXPECT_LT((p.head<2>() - Eigen::Vector2d(x, y)).norm(), 1.0);
      ++observations;
    }
  }
  EXPECT_GE(observations, 3 * static_cast<int>(position.size()));
}

TEST_F(SynthTest, RejectsANonEmptyFolder) {
  const std::string before = *ReadFile(folder_ + "/scene.json");
  const auto report = SynthesizeCity(Toy(12), folder_, {});
  EXPECT_EQ(report.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(*ReadFile(folder_ + "/scene.json"), before);
}

TEST(SynthOptionsTest, RejectsInvalidOptions) {
  SynthOptions options;
  options.columns = 0;
  options.gsd_m = -1;
  const std::string folder = OwnFolder() + "synth_never";
  const auto report = SynthesizeCity(options, folder, {});
  EXPECT_EQ(report.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(report.status().message()),
              testing::AllOf(testing::HasSubstr("blocks"), testing::HasSubstr("gsd")));
  EXPECT_FALSE(std::filesystem::exists(folder));
}

TEST(PlanFlightTest, NeighbouringImagesHaveTheStatedOverlap) {
  const CityPlan plan{4, 4, 2, 0.12};
  const auto views = PlanFlight(plan, 1000, 750);
  const double width_m = 1000 * plan.gsd_m, height_m = 750 * plan.gsd_m;
  std::map<std::string, Eigen::Vector2d> nadir;
  for (const SynthView& view : views) {
    if (view.direction != 0) continue;
    nadir[view.stem] = view.target;
    // The axis meets the ground at the target, and a metre there is 1 / GSD pixels.
    const Eigen::Vector3d ground(view.target.x(), view.target.y(),
                                 TerrainHeight(plan, view.target.x(), view.target.y()));
    const Eigen::Vector3d p = view.camera.Project(ground);
    EXPECT_NEAR(view.camera.intrinsics.fx / p.z(), 1 / plan.gsd_m, 0.05 / plan.gsd_m);
  }
  int along = 0, across = 0;
  for (const auto& [stem, target] : nadir) {
    int line, station;
    ASSERT_EQ(std::sscanf(stem.c_str(), "nadir_%d_%d", &line, &station), 2);
    char next[48];
    std::snprintf(next, sizeof next, "nadir_%02d_%03d", line, station + 1);
    if (nadir.count(next)) {
      EXPECT_NEAR(1 - std::abs(nadir[next].y() - target.y()) / height_m, kForwardOverlap, 0.03);
      ++along;
    }
    std::snprintf(next, sizeof next, "nadir_%02d_%03d", line + 1, station);
    if (nadir.count(next)) {
      EXPECT_NEAR(1 - std::abs(nadir[next].x() - target.x()) / width_m, kSideOverlap, 0.03);
      ++across;
    }
  }
  EXPECT_GT(along, 5);
  EXPECT_GT(across, 5);
}

}  // namespace
}  // namespace tessera
