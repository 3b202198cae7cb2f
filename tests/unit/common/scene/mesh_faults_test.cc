// Meshes with the faults of other programs: a scene is checked as with the mesh without them, and each is reported.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <string>
#include <utility>

#include "common/check/check.h"
#include "common/scene/scene.h"
#include "tests/support/bent_meshes.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::Contains;
using testing::HasSubstr;

struct CheckedMesh {
  SceneSummary summary;
  Warnings warnings;
};

// Checks a tiny scene in UTM coordinates whose mesh is changed by `bend`.
CheckedMesh CheckBent(const std::string& name, const std::function<void(TriangleMesh*)>& bend) {
  const std::string folder = FreshTestFolder(name);
  TinySceneOptions options;
  options.offset = {386512, 6671850, 20};
  options.crs_json = R"({"type": "utm", "zone": 35})";
  TriangleMesh mesh = WriteTinyScene(folder, options).mesh;
  bend(&mesh);
  WriteText(folder + "/mesh.ply", AsciiPly(mesh, "double"));
  CheckedMesh out;
  const auto summary = CheckSceneFolder(folder, &out.warnings, TaskControl());
  EXPECT_TRUE(summary.ok()) << summary.status();
  if (summary.ok()) out.summary = *summary;
  return out;
}

TEST(MeshFaults, AreRepairedAndReported) {
  const CheckedMesh good = CheckBent("good", [](TriangleMesh*) {});
  EXPECT_THAT(good.warnings, testing::Not(Contains(HasSubstr("mesh: "))));
  const auto expect = [&](const std::string& name, const std::string& warning,
                          const std::function<void(TriangleMesh*)>& bend) {
    SCOPED_TRACE(name);
    const CheckedMesh bent = CheckBent(name, bend);
    EXPECT_THAT(bent.warnings, Contains(HasSubstr(warning)));
    EXPECT_NEAR(bent.summary.gsd_m, good.summary.gsd_m, 0.01);
    EXPECT_NEAR(bent.summary.unseen_share, good.summary.unseen_share, 0.02);
    EXPECT_NEAR(bent.summary.extent_m2, good.summary.extent_m2, 1e-6);
    EXPECT_NEAR(*bent.summary.lat_deg, *good.summary.lat_deg, 1e-9);
  };
  expect("soup", "vertices on borders at the same place welded (first: vertex ",
         [](TriangleMesh* mesh) { *mesh = Soup(*mesh); });
  expect("tiles", "vertices on borders at the same place welded (first: vertex ",
         [](TriangleMesh* mesh) { *mesh = Tiles(*mesh, 3); });
  expect("inside_out", "faces turned: they faced inwards or against their neighbours (first: face 0)",
         [](TriangleMesh* mesh) {
           for (Triangle& face : mesh->faces) std::swap(face[1], face[2]);
         });
  expect("origin", "mesh: 1 vertices far from all that the images show removed, with 6 faces (first: vertex 100)",
         [](TriangleMesh* mesh) { mesh->vertices[100].setZero(); });
}

}  // namespace
}  // namespace tessera
