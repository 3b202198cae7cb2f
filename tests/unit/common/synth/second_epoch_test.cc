#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>

#include "common/base/parallel.h"
#include "common/geometry/ray_caster.h"
#include "common/imaging/image_io.h"
#include "common/meshio/ply.h"
#include "common/scene/scene.h"
#include "common/storage/files.h"
#include "common/synth/city/city_scene.h"
#include "common/synth/city/epoch_changes.h"
#include "common/synth/city/ring.h"
#include "common/synth/synth.h"
#include "tests/unit/common/synth/all_files.h"

namespace tessera {
namespace {

using Eigen::AlignedBox2d;
using Eigen::Vector2d;
using Eigen::Vector3d;

std::string Scratch() { return testing::TempDir() + "second_epoch_test/"; }

// Five by five blocks, and the default part.
const CityPlan& Plan() {
  static const CityPlan plan{5, 5, 7, 0.3};
  return plan;
}
AlignedBox2d Part() { return {Vector2d(-44, -44), Vector2d(44, 44)}; }

const ChangedCity& City() {
  static const ChangedCity city = ChangeCity(Plan(), Part(), 1);
  return city;
}

CityScene SceneOf(const CityPlan& plan) { return {plan, MakeGroundGrid(plan), {0, 5, 0, 5}}; }
const CityScene& Before() {
  static const CityScene scene = SceneOf(Plan());
  return scene;
}
const CityScene& After() {
  static const CityScene scene = SceneOf(City().plan);
  return scene;
}

RayHit FromAbove(const CityScene& scene, const Vector2d& p) {
  return scene.caster().Cast({p.x(), p.y(), 500}, -Vector3d::UnitZ());
}

TEST(ChangeCityTest, HasAllKindsAndRespectsMinimumSizes) {
  std::map<ChangeKind, int> counts;
  double largest = 0;
  for (const CityChange& change : City().changes) {
    ++counts[change.kind];
    largest = std::max(largest, change.area_m2);
    EXPECT_GE(change.area_m2, change.kind == ChangeKind::kFelled ? kMinFelledArea_m2 : kMinChangeArea_m2);
  }
  EXPECT_GE(counts[ChangeKind::kBuilt], 3);
  EXPECT_GE(counts[ChangeKind::kDemolished], 2);
  EXPECT_GE(counts[ChangeKind::kGrown], 2);
  EXPECT_GE(counts[ChangeKind::kFelled], 2);
  EXPECT_GE(counts[ChangeKind::kLabel], 2);
  EXPECT_GT(largest, 100);
}

TEST(ChangeCityTest, RespectsInsetAndDistances) {
  const auto& changes = City().changes;
  for (size_t k = 0; k < changes.size(); ++k) {
    const AlignedBox2d box = BoxOf(changes[k].footprint);
    for (const double side : {(box.min() - Part().min()).minCoeff(), (Part().max() - box.max()).minCoeff()}) {
      EXPECT_GE(side, ChangeInset(Part()) - 0.01);
    }
    for (size_t other = 0; other < k; ++other) {
      EXPECT_GT(box.exteriorDistance(BoxOf(changes[other].footprint)), 2.9);
    }
  }
}

TEST(ChangeCityTest, HeightsAndLabelsChangeInsideFootprints) {
  for (const CityChange& change : City().changes) {
    SCOPED_TRACE(ChangeKindName(change.kind));
    const AlignedBox2d box = BoxOf(change.footprint);
    constexpr double kStep = 0.07;
    double sum = 0;
    int points = 0, moved = 0, relabelled = 0;
    for (double y = box.min().y() + 0.5 * kStep; y < box.max().y(); y += kStep) {
      for (double x = box.min().x() + 0.5 * kStep; x < box.max().x(); x += kStep) {
        if (!Inside(change.footprint, {x, y})) continue;
        const RayHit before = FromAbove(Before(), {x, y}), after = FromAbove(After(), {x, y});
        const double rise = before.distance - after.distance;
        sum += rise;
        ++points;
        moved += std::abs(rise) > 1;
        relabelled += Before().surface().mesh.labels[before.face] != After().surface().mesh.labels[after.face];
      }
    }
    EXPECT_NEAR(points * kStep * kStep, change.area_m2, 0.03 * change.area_m2);
    EXPECT_NEAR(sum / points, change.height_difference_m, 0.05 + 0.02 * std::abs(change.height_difference_m));
    switch (change.kind) {
      case ChangeKind::kBuilt:
      case ChangeKind::kGrown:
        EXPECT_GT(change.height_difference_m, 1.5);
        break;
      case ChangeKind::kDemolished:
      case ChangeKind::kFelled:
        EXPECT_LT(change.height_difference_m, -1.5);
        break;
      case ChangeKind::kLabel:
        EXPECT_EQ(change.height_difference_m, 0);
        EXPECT_EQ(moved, 0);
        EXPECT_GT(relabelled, 0.75 * points);  // a roof's stair head stays one
        continue;
    }
    EXPECT_GT(moved, 0.7 * points);
  }
}

bool HasPatch(const TexturedSurface& surface, uint64_t seed) {
  return std::any_of(surface.patches.begin(), surface.patches.end(),
                     [&](const SurfacePatch& patch) { return patch.seed == seed; });
}

// Compares heights, classes and textures.
TEST(ChangeCityTest, SurfaceOutsideFootprintsIsUnchanged) {
  constexpr double kMargin = 0.7;  // balconies and cornices stand out of a roof's outline
  int same = 0, ambiguous = 0;
  for (double y = -110; y <= 110; y += 0.37) {
    for (double x = -110; x <= 110; x += 0.37) {
      const bool near = std::any_of(City().changes.begin(), City().changes.end(), [&](const CityChange& change) {
        return BoxOf(change.footprint).exteriorDistance(Vector2d(x, y)) < kMargin;
      });
      if (near) continue;
      const RayHit before = FromAbove(Before(), {x, y}), after = FromAbove(After(), {x, y});
      ASSERT_NEAR(before.distance, after.distance, 1e-4) << x << " " << y;
      const TexturedSurface &old_surface = Before().surface(), &new_surface = After().surface();
      ASSERT_EQ(old_surface.mesh.labels[before.face], new_surface.mesh.labels[after.face]) << x << " " << y;
      const SurfacePatch& a = old_surface.patches[old_surface.patch_of_face[before.face]];
      const SurfacePatch& b = new_surface.patches[new_surface.patch_of_face[after.face]];
      ASSERT_EQ(a.material, b.material) << x << " " << y;
      // Where roofs of equal height meet, a ray may hit either of them in both cities.
      if (a.seed != b.seed && HasPatch(new_surface, a.seed) && HasPatch(old_surface, b.seed)) {
        ++ambiguous;
        continue;
      }
      ASSERT_EQ(a.seed, b.seed) << x << " " << y;
      ASSERT_EQ(a.origin, b.origin) << x << " " << y;
      ASSERT_EQ(a.albedo, b.albedo) << x << " " << y;
      ++same;
    }
  }
  EXPECT_GT(same, 300000);
  EXPECT_LT(ambiguous, 10);
  EXPECT_EQ(Before().sun(), After().sun());
}

// Every face of the changed city away from changes is bit-identical to a face of the base city.
TEST(ChangeCityTest, UnchangedFacesAreBitIdentical) {
  using Face = std::array<double, 9>;
  const auto faces_of = [](const CityScene& scene) {
    std::multiset<Face> faces;
    const TriangleMesh& mesh = scene.surface().mesh;
    for (const Triangle& t : mesh.faces) {
      Face face;
      bool near = false;
      for (int k = 0; k < 3; ++k) {
        const Vector3d& p = mesh.vertices[t[k]];
        for (int axis = 0; axis < 3; ++axis) face[3 * k + axis] = p[axis];
        for (const CityChange& change : City().changes) {
          near |= BoxOf(change.footprint).exteriorDistance(Vector2d(p.head<2>())) < 0.7;
        }
      }
      if (!near) faces.insert(face);
    }
    return faces;
  };
  const auto before = faces_of(Before()), after = faces_of(After());
  EXPECT_GT(before.size(), 100000u);
  EXPECT_TRUE(before == after);
}

TEST(ChangeCityTest, IsDeterministicPerSeed) {
  const ChangedCity again = ChangeCity(Plan(), Part(), 1), other = ChangeCity(Plan(), Part(), 2);
  const auto footprints = [](const ChangedCity& city) {
    std::vector<std::vector<Vector2d>> list;
    for (const CityChange& change : city.changes) list.push_back(change.footprint);
    return list;
  };
  EXPECT_EQ(footprints(City()), footprints(again));
  EXPECT_NE(footprints(City()), footprints(other));
}

SynthOptions Toy() {
  SynthOptions options;
  options.columns = options.rows = 2;
  options.seed = 5;
  options.gsd_m = 0.6;
  options.image_width_px = 120;
  options.image_height_px = 90;
  return options;
}

// One small city for all tests that only read it.
class SecondEpochTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    std::filesystem::remove_all(Scratch());
    const auto report = SynthesizeCity(Toy(), Base(), {});
    ASSERT_TRUE(report.ok()) << report.status();
  }
  static void TearDownTestSuite() { std::filesystem::remove_all(Scratch()); }
  static std::string Base() { return Scratch() + "base"; }
  static SecondEpochOptions Options() {
    SecondEpochOptions options;
    options.base_folder = Base();
    options.part = {0.2, 0.2, 0.8, 0.8};
    return options;
  }
};

TEST_F(SecondEpochTest, DefaultSceneHasOnlyCamerasAndImagesForAnyNumberOfThreads) {
  const std::string first = Scratch() + "one/next", second = Scratch() + "two/next";
  const auto report = SynthesizeSecondEpoch(Options(), first, {});
  ASSERT_TRUE(report.ok()) << report.status();
  {
    ThreadLimit limit(1);
    ASSERT_TRUE(SynthesizeSecondEpoch(Options(), second, {}).ok());
  }
  const auto files = AllFiles(first);
  EXPECT_TRUE(files == AllFiles(second));
  EXPECT_EQ(files.count("mesh.ply"), 0u);
  EXPECT_EQ(nlohmann::json::parse(files.at("scene.json")).count("mesh"), 0u);
  int64_t images = 0;
  for (const auto& [name, bytes] : files) {
    images += name.starts_with("images/");
    EXPECT_FALSE(name.starts_with("images/") && FileExists(Base() + "/" + name)) << name;
  }
  EXPECT_EQ(images, report->images);
  EXPECT_GE(images, 15);
}

TEST_F(SecondEpochTest, WithoutChangesOnlyTheFlightDiffers) {
  SecondEpochOptions options = Options();
  options.changes = false;
  std::map<std::string, std::string> flights[2];
  for (const uint64_t seed : {1, 2}) {
    options.seed = seed;
    const std::string folder = Scratch() + "unchanged" + std::to_string(seed);
    const auto report = SynthesizeSecondEpoch(options, folder, {});
    ASSERT_TRUE(report.ok()) << report.status();
    for (const int64_t changes : report->changes) EXPECT_EQ(changes, 0);
    EXPECT_GE(report->images, 15);
    flights[seed - 1] = AllFiles(folder);
  }
  EXPECT_EQ(flights[0].at("truth/mesh.ply"), *ReadFile(Base() + "/truth/mesh.ply"));
  EXPECT_EQ(flights[1].at("truth/mesh.ply"), *ReadFile(Base() + "/truth/mesh.ply"));
  EXPECT_NE(flights[0].at("colmap/images.txt"), flights[1].at("colmap/images.txt")) << "another flight";
}

TEST_F(SecondEpochTest, GeoJsonRingsAreClosedCounterClockwiseAndMatchTheirArea) {
  const std::string folder = Scratch() + "geojson";
  ASSERT_TRUE(SynthesizeSecondEpoch(Options(), folder, {}).ok());
  const auto json = nlohmann::json::parse(*ReadFile(folder + "/truth/changes.geojson"));
  EXPECT_EQ(json.at("type"), "FeatureCollection");
  ASSERT_GE(json.at("features").size(), 3u);
  const std::set<std::string> kinds = {"built", "demolished", "grown", "felled", "label"};
  for (const auto& feature : json.at("features")) {
    EXPECT_EQ(feature.at("type"), "Feature");
    EXPECT_EQ(feature.at("geometry").at("type"), "Polygon");
    ASSERT_EQ(feature.at("geometry").at("coordinates").size(), 1u);
    const auto ring = feature.at("geometry").at("coordinates").at(0).get<std::vector<std::array<double, 2>>>();
    EXPECT_EQ(ring.front(), ring.back());
    double area = 0;
    for (size_t k = 0; k + 1 < ring.size(); ++k) {
      area += 0.5 * (ring[k][0] * ring[k + 1][1] - ring[k][1] * ring[k + 1][0]);
    }
    EXPECT_NEAR(area, feature.at("properties").at("area_m2").get<double>(), 0.001);
    EXPECT_TRUE(kinds.count(feature.at("properties").at("kind").get<std::string>()));
    EXPECT_TRUE(feature.at("properties").at("height_difference_m").is_number());
  }
}

TEST_F(SecondEpochTest, WholeSceneHasBothFlightsAndTheBaseFiles) {
  const std::string folder = Scratch() + "whole";
  SecondEpochOptions options = Options();
  options.whole = true;
  const auto report = SynthesizeSecondEpoch(options, folder, {});
  ASSERT_TRUE(report.ok()) << report.status();
  Warnings warnings;
  const auto scene = LoadScene(folder, &warnings), base = LoadScene(Base(), nullptr);
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_TRUE(base.ok()) << base.status();
  EXPECT_THAT(warnings, testing::IsEmpty());
  ASSERT_EQ(scene->flights.size(), 2u);
  EXPECT_EQ(static_cast<int64_t>(scene->views.size()), report->images);
  std::map<std::string, int> views_of;
  for (const SceneView& view : scene->views) ++views_of[scene->flights[view.flight].date];
  EXPECT_EQ(views_of["2026-05-14"], static_cast<int>(base->views.size()));
  EXPECT_EQ(views_of["2026-05-14"] + views_of["2027-05-14"], report->images);
  EXPECT_GT(views_of["2027-05-14"], 0);
  EXPECT_EQ(*ReadFile(folder + "/mesh.ply"), *ReadFile(Base() + "/mesh.ply"));
  for (const SceneView& view : base->views) {
    EXPECT_EQ(*ReadFile(folder + "/" + view.image_path), *ReadFile(Base() + "/" + view.image_path));
    EXPECT_EQ(*ReadFile(folder + "/" + view.likelihood_path), *ReadFile(Base() + "/" + view.likelihood_path));
  }
}

TEST_F(SecondEpochTest, NewMeshDiffersOnlyNearChanges) {
  const std::string folder = Scratch() + "new_mesh";
  SecondEpochOptions options = Options();
  options.new_mesh = true;
  ASSERT_TRUE(SynthesizeSecondEpoch(options, folder, {}).ok());
  const auto before = ReadPly(Base() + "/mesh.ply"), after = ReadPly(folder + "/mesh.ply");
  ASSERT_TRUE(before.ok() && after.ok());
  const auto json = nlohmann::json::parse(*ReadFile(folder + "/truth/changes.geojson"));
  std::vector<AlignedBox2d> boxes;
  for (const auto& feature : json.at("features")) {
    AlignedBox2d box;
    for (const auto& p : feature.at("geometry").at("coordinates").at(0)) {
      box.extend(Vector2d(p.at(0).get<double>(), p.at(1).get<double>()));
    }
    boxes.push_back(box);
  }
  // Vertices and labels, far from changes: the occupancy is blurred over a few voxels of 3 m.
  const auto far_faces = [&](const TriangleMesh& mesh) {
    std::multiset<std::array<double, 4>> faces;
    for (size_t f = 0; f < mesh.faces.size(); ++f) {
      const Triangle& t = mesh.faces[f];
      const Vector3d p = mesh.vertices[t[0]] + mesh.vertices[t[1]] + mesh.vertices[t[2]];
      const bool near = std::any_of(boxes.begin(), boxes.end(), [&](const AlignedBox2d& box) {
        return box.exteriorDistance(Vector2d(p.head<2>() / 3)) < 12;
      });
      if (!near) faces.insert({p.x(), p.y(), p.z(), static_cast<double>(mesh.labels[f])});
    }
    return faces;
  };
  const auto old_faces = far_faces(before->mesh), new_faces = far_faces(after->mesh);
  EXPECT_GT(old_faces.size(), 200u);
  EXPECT_TRUE(old_faces == new_faces);
  EXPECT_NE(*ReadFile(folder + "/mesh.ply"), *ReadFile(Base() + "/mesh.ply"));
}

TEST_F(SecondEpochTest, RejectsInvalidInput) {
  SecondEpochOptions options = Options();
  const std::string folder = Scratch() + "never";
  options.base_folder = Scratch() + "missing";
  auto status = SynthesizeSecondEpoch(options, folder, {}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), testing::HasSubstr("missing/synth.json"));
  ASSERT_TRUE(EnsureFolder(options.base_folder).ok());
  ASSERT_TRUE(WriteFileAtomic(options.base_folder + "/synth.json", "{\"parameters\": 3}").ok());
  status = SynthesizeSecondEpoch(options, folder, {}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), testing::HasSubstr("missing/synth.json"));
  options = Options();
  options.part = {0.5, 0.2, 0.4, 0.8};
  status = SynthesizeSecondEpoch(options, folder, {}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), testing::HasSubstr("part"));
  EXPECT_FALSE(std::filesystem::exists(folder));
  options = Options();
  options.overwrite = true;
  status = SynthesizeSecondEpoch(options, Base(), {}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(FileExists(Base() + "/mesh.ply"));
}

}  // namespace
}  // namespace tessera
