// Updates of a city whose mesh changes in places: kept faces keep their ids and split, and the surface has no cracks.
#include "worker/city/revise_city.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "common/base/random.h"
#include "common/geometry/repair.h"
#include "tests/support/tiny_scene.h"
#include "tests/unit/worker/city/to_disk.h"

namespace tessera {
namespace {

constexpr int kSide = 14;

DiskMesh Repaired(const TriangleMesh& mesh) {
  MeshDefects defects;
  return *RepairOnDisk(ToDisk(mesh), testing::TempDir(), DiskPassOptions(), RepairOptions(), &defects);
}

// Hilly ground of 4 m squares.
TriangleMesh Hills(Random* random) {
  TriangleMesh mesh;
  for (int y = 0; y <= kSide; ++y) {
    for (int x = 0; x <= kSide; ++x) {
      mesh.vertices.push_back({4.0 * x, 4.0 * y, std::ldexp(static_cast<double>(random->Below(256)), -6)});
    }
  }
  for (uint32_t y = 0; y < kSide; ++y) {
    for (uint32_t x = 0; x < kSide; ++x) {
      const uint32_t v = y * (kSide + 1) + x, up = v + kSide + 1;
      mesh.faces.push_back({v, v + 1, up + 1});
      mesh.faces.push_back({v, up + 1, up});
    }
  }
  for (size_t f = 0; f < mesh.faces.size(); ++f) mesh.labels.push_back(static_cast<int32_t>(random->Below(2)));
  return mesh;
}

// Nadir cameras at several heights, so that faces are split unevenly.
std::vector<PosedCamera> Cameras(Random* random) {
  std::vector<PosedCamera> cameras;
  for (int i = 0; i < 3; ++i) {
    PosedCamera camera;
    camera.intrinsics = {100, 100, 80, 60, 160, 120};
    camera.rotation_cam_from_world = Eigen::Vector3d(1, -1, -1).asDiagonal();
    const Eigen::Vector3d centre(4.0 * random->Below(kSide), 4.0 * random->Below(kSide),
                                 20.0 + 20.0 * random->Below(4));
    camera.translation_cam_from_world = -(camera.rotation_cam_from_world * centre);
    cameras.push_back(camera);
  }
  return cameras;
}

const GroundPlane& Ground() {
  static const GroundPlane ground = MakeGroundPlane(Eigen::Vector3d::UnitZ(), 8);
  return ground;
}

CityReader Write(const CitySpans& spans) {
  const std::string path = FreshTestFolder("city") + "/city.arrays";
  const Status written = WriteCity(path, spans, Ground(), CellsOf(spans.mesh, Ground()), testing::TempDir(), 300);
  EXPECT_TRUE(written.ok()) << written;
  auto city = CityReader::Open(path);
  EXPECT_TRUE(city.ok()) << city.status();
  return *std::move(city);
}

CityReader CityOf(const TriangleMesh& mesh, const std::vector<PosedCamera>& cameras) {
  const DiskMesh split = *SplitOnDisk(Repaired(mesh), cameras, DensityOptions(), testing::TempDir(), DiskPassOptions(),
                                      [](double) { return absl::OkStatus(); });
  return Write({split.spans(), split.input_face.values()});
}

RevisedCity Revise(const CityReader& city, const TriangleMesh& base, const TriangleMesh& now,
                   const std::vector<PosedCamera>& cameras) {
  auto revised =
      ReviseCity(city, Repaired(base), Repaired(now), Ground(), cameras, DensityOptions(), testing::TempDir(), {});
  EXPECT_TRUE(revised.ok()) << revised.status();
  return *std::move(revised);
}

// The same surface with permuted vertices and faces.
TriangleMesh Shuffled(const TriangleMesh& mesh, Random* random) {
  const auto order = [&](size_t count) {
    std::vector<uint32_t> to(count);
    std::iota(to.begin(), to.end(), 0u);
    for (size_t i = count; i > 1; --i) std::swap(to[i - 1], to[random->Below(i)]);
    return to;
  };
  const std::vector<uint32_t> vertex_to = order(mesh.vertices.size()), face_to = order(mesh.faces.size());
  TriangleMesh out = mesh;
  for (size_t v = 0; v < vertex_to.size(); ++v) out.vertices[vertex_to[v]] = mesh.vertices[v];
  for (size_t f = 0; f < face_to.size(); ++f) {
    const size_t turn = random->Below(3);
    for (size_t k = 0; k < 3; ++k) out.faces[face_to[f]][k] = vertex_to[mesh.faces[f][(k + turn) % 3]];
    out.labels[face_to[f]] = mesh.labels[f];
  }
  return out;
}

// Changes a district: adds and removes houses, deletes a face, changes labels.
TriangleMesh Changed(TriangleMesh mesh, Random* random) {
  const int x0 = static_cast<int>(random->Below(kSide - 4)), y0 = static_cast<int>(random->Below(kSide - 4));
  for (int y = y0; y < y0 + 3; ++y) {
    for (int x = x0; x < x0 + 3; ++x) mesh.vertices[y * (kSide + 1) + x].z() += static_cast<double>(random->Below(3));
  }
  for (int i = 0; i < 3; ++i) {
    const size_t gone = random->Below(mesh.faces.size());
    mesh.faces.erase(mesh.faces.begin() + static_cast<std::ptrdiff_t>(gone));
    mesh.labels.erase(mesh.labels.begin() + static_cast<std::ptrdiff_t>(gone));
  }
  mesh.labels[random->Below(mesh.labels.size())] ^= 1;
  return mesh;
}

double RimLength(const MeshSpans& mesh) {
  std::map<std::array<uint32_t, 2>, int> uses;
  for (const Triangle& face : mesh.faces) {
    for (int k = 0; k < 3; ++k) {
      const uint32_t a = face[k], b = face[(k + 1) % 3];
      ++uses[{std::min(a, b), std::max(a, b)}];
    }
  }
  double length = 0;
  for (const auto& [edge, count] : uses) {
    EXPECT_LE(count, 2);
    if (count == 1) length += (mesh.vertices[edge[0]] - mesh.vertices[edge[1]]).norm();
  }
  return length;
}

// The city's faces by id.
struct KnownFace {
  std::array<std::array<double, 3>, 3> corners;
  Triangle vertices;
  int32_t label;
  bool operator==(const KnownFace&) const = default;
};
std::map<uint32_t, KnownFace> FacesOf(const CityReader& city) {
  std::map<uint32_t, KnownFace> faces;
  for (size_t b = 0; b < city.block_count(); ++b) {
    const CityBlock block = *city.Block(b);
    for (size_t f = 0; f < block.face_ids.size(); ++f) {
      KnownFace& face = faces[block.face_ids[f]];
      face.vertices = block.GlobalFace(f);
      face.label = block.mesh.labels[f];
      for (int k = 0; k < 3; ++k) {
        const Eigen::Vector3d& p = block.mesh.Corner(f, k);
        face.corners[k] = {p.x(), p.y(), p.z()};
      }
    }
  }
  return faces;
}

// Expects `revised` to be a split of `now` without cracks, in which reused ids of `city` stand for the same faces.
void ExpectValidUpdate(const CityReader& city, const TriangleMesh& now, const RevisedCity& revised) {
  const MeshSpans mesh = revised.mesh.spans();
  const DiskMesh repaired = Repaired(now);
  EXPECT_NEAR(RimLength(mesh), RimLength(repaired.spans()), 1e-6) << "no cracks";
  std::vector<double> area(now.faces.size(), 0), expected(now.faces.size(), 0);
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const uint32_t of = revised.mesh.input_face[f];
    ASSERT_LT(of, area.size());
    area[of] += FaceArea(mesh, f);
    EXPECT_EQ(mesh.labels[f], now.labels[of]);
  }
  for (size_t f = 0; f < repaired.faces.size(); ++f) {
    expected[repaired.input_face.size() > 0 ? repaired.input_face[f] : f] = FaceArea(repaired.spans(), f);
  }
  for (size_t f = 0; f < area.size(); ++f) EXPECT_NEAR(area[f], expected[f], 1e-9) << "face " << f << " of the file";

  const auto before = FacesOf(city), after = FacesOf(Write(revised.spans()));
  std::set<std::array<int, 2>> cells;
  const auto add_cell = [&](const KnownFace& face) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const auto& p : face.corners) sum += Eigen::Vector3d(p[0], p[1], p[2]);
    const Eigen::Vector2i at = Ground().Cell(sum / 3);
    cells.insert({at.x(), at.y()});
  };
  int64_t kept = 0;
  for (const auto& [id, face] : after) {
    const auto known = before.find(id);
    if (known == before.end()) {
      EXPECT_GE(id, city.face_ids_end()) << "an id is never used again";
      add_cell(face);
    } else {
      EXPECT_TRUE(known->second == face) << "face " << id;
      ++kept;
    }
  }
  for (const auto& [id, face] : before) {
    if (!after.contains(id)) add_cell(face);
  }
  EXPECT_EQ(kept, revised.kept_faces);
  EXPECT_EQ(cells, revised.changed_cells);
}

TEST(ReviseCity, ReorderedMeshGivesTheSameCity) {
  Random random(1);
  const TriangleMesh mesh = Hills(&random);
  const CityReader city = CityOf(mesh, Cameras(&random));
  ASSERT_GT(city.faces(), static_cast<int64_t>(mesh.faces.size())) << "it is split";
  const TriangleMesh now = Shuffled(mesh, &random);
  const RevisedCity revised = Revise(city, mesh, now, Cameras(&random));
  EXPECT_TRUE(revised.changed_cells.empty());
  EXPECT_TRUE(FacesOf(Write(revised.spans())) == FacesOf(city));
  ExpectValidUpdate(city, now, revised);
}

TEST(ReviseCity, KeptFacesKeepTheirIdsWithoutCracks) {
  for (uint64_t seed = 0; seed < 12; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const TriangleMesh mesh = Hills(&random);
    const CityReader city = CityOf(mesh, Cameras(&random));
    const TriangleMesh now = Shuffled(Changed(mesh, &random), &random);
    const RevisedCity revised = Revise(city, mesh, now, Cameras(&random));
    ExpectValidUpdate(city, now, revised);
    std::set<uint32_t> fresh;  // of the file
    for (size_t f = static_cast<size_t>(revised.kept_faces); f < revised.face_ids.size(); ++f) {
      fresh.insert(revised.mesh.input_face[f]);
    }
    EXPECT_GE(fresh.size(), 15u) << "vertices of the district that moved have 32 faces about them at most";
    EXPECT_LE(fresh.size(), 33u);
    // Update again, now with gaps between ids.
    const CityReader second = Write(revised.spans());
    const TriangleMesh last = Shuffled(Changed(mesh, &random), &random);
    ExpectValidUpdate(second, last, Revise(second, now, last, Cameras(&random)));
  }
}

// New faces split the edges that they share with kept ones as often as these, and for the same reasons.
TEST(ReviseCity, CityMayHaveBeenSplitTwice) {
  const auto go_on = [](double) { return absl::OkStatus(); };
  for (uint64_t seed = 0; seed < 6; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const TriangleMesh mesh = Hills(&random);
    const std::vector<PosedCamera> cameras = Cameras(&random);
    DiskMesh moved = *SplitOnDisk(Repaired(mesh), cameras, {.max_footprint_px2 = 64}, testing::TempDir(),
                                  DiskPassOptions(), go_on);
    moved.starts = *ScratchArray<Eigen::Vector3d>::Create(testing::TempDir(), moved.vertices.size());
    for (size_t v = 0; v < moved.vertices.size(); ++v) {
      moved.starts[v] = moved.vertices[v];
      for (int k = 0; k < 3; ++k) moved.vertices[v][k] += 0.5 * random.Uniform();
    }
    const DiskMesh split = *SplitOnDisk(std::move(moved), cameras, {.max_footprint_px2 = 4}, testing::TempDir(),
                                        DiskPassOptions(), go_on);
    MeshSpans start = split.spans();
    start.vertices = split.starts.values();
    const CityReader city = Write({start, split.input_face.values()});
    const TriangleMesh now = Shuffled(Changed(mesh, &random), &random);
    const auto revised = ReviseCity(city, Repaired(mesh), Repaired(now), Ground(), cameras, {.max_rounds = 1},
                                    testing::TempDir(), {});
    ASSERT_TRUE(revised.ok()) << revised.status();
    ExpectValidUpdate(city, now, *revised);
  }
}

TEST(ReviseCity, SeparatedFansGetNewIds) {
  // Two faces that share only a corner are two fans after repair; before, they were one.
  Random random(3);
  const TriangleMesh mesh = Hills(&random);
  const CityReader city = CityOf(mesh, Cameras(&random));
  TriangleMesh now = mesh;
  const uint32_t corner = 5 * (kSide + 1) + 5;
  std::vector<size_t> about;
  for (size_t f = 0; f < now.faces.size(); ++f) {
    if (std::find(now.faces[f].begin(), now.faces[f].end(), corner) != now.faces[f].end()) about.push_back(f);
  }
  ASSERT_EQ(about.size(), 6u);
  // The faces around a vertex by angle; every third stays.
  std::sort(about.begin(), about.end(), [&](size_t a, size_t b) {
    const auto angle = [&](size_t f) {
      const MeshSpans spans(mesh);
      const Eigen::Vector3d d = spans.Centroid(f) - mesh.vertices[corner];
      return std::atan2(d.y(), d.x());
    };
    return angle(a) < angle(b);
  });
  std::vector<size_t> gone = {about[1], about[2], about[4], about[5]};
  std::sort(gone.rbegin(), gone.rend());
  for (const size_t f : gone) {
    now.faces.erase(now.faces.begin() + static_cast<std::ptrdiff_t>(f));
    now.labels.erase(now.labels.begin() + static_cast<std::ptrdiff_t>(f));
  }
  const RevisedCity revised = Revise(city, mesh, now, Cameras(&random));
  ExpectValidUpdate(city, now, revised);
  EXPECT_GT(static_cast<int64_t>(revised.face_ids.size()), revised.kept_faces) << "the two faces are new";
}

TEST(ReviseCity, RejectsACityThatIsNotASplitOfTheMesh) {
  Random random(4);
  const TriangleMesh mesh = Hills(&random);
  TriangleMesh less = mesh;
  less.faces.resize(less.faces.size() / 2);
  less.labels.resize(less.faces.size());
  const CityReader city = CityOf(less, {});
  const auto revised =
      ReviseCity(city, Repaired(mesh), Repaired(mesh), Ground(), {}, DensityOptions(), testing::TempDir(), {});
  EXPECT_EQ(revised.status().code(), absl::StatusCode::kDataLoss) << revised.status();
}

}  // namespace
}  // namespace tessera
