// A tile computes what the whole city computes, to the last bit, wherever its cut cannot have reached.
#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "common/base/clock.h"
#include "tests/support/held_pixels.h"
#include "tests/support/tiny_scene.h"
#include "worker/tasks/cell_views.h"
#include "worker/tasks/cut_tile.h"
#include "worker/tasks/refine_tile.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

class ExactTileTest : public testing::Test {
 protected:
  ExactTileTest() : scene_(MakeTinyScene()) {
    TriangleMesh start = scene_.mesh;
    std::vector<uint32_t> input_face;
    // Off the truth, so that there is something to do.
    for (size_t v = 0; v < start.vertices.size(); ++v) {
      start.vertices[v].z() += 0.15 * std::sin(1.7 * static_cast<double>(v));
    }
    for (size_t f = 0; f < scene_.mesh.faces.size(); ++f) input_face.push_back(static_cast<uint32_t>(f));
    survey_.gsd_m = 0.08;  // less than it is, so that what counts as near fits the halo
    survey_.ground = MakeGroundPlane(survey_.up, 4);
    survey_.classes.resize(3);
    for (size_t v = 0; v < scene_.cameras.size(); ++v) {
      SceneView view;
      view.camera = scene_.cameras[v];
      view.lens.pinhole = view.camera.intrinsics;
      survey_.views.push_back(view);
      all_views_.push_back(static_cast<int32_t>(v));
      for (size_t w = 0; w < scene_.cameras.size(); ++w) {
        if (v != w) survey_.pairs.push_back({static_cast<int32_t>(v), static_cast<int32_t>(w)});
      }
    }
    survey_.faces = static_cast<int64_t>(scene_.mesh.faces.size());
    survey_.cells = CellsOf(start, survey_.ground);
    const std::string path = FreshTestFolder("city") + "/city.arrays";
    EXPECT_TRUE(WriteCity(path, {start, input_face}, survey_.ground, survey_.cells, testing::TempDir(), 500).ok());
    auto opened = CityReader::Open(path);
    EXPECT_TRUE(opened.ok()) << opened.status();
    city_ = *std::move(opened);
    EXPECT_TRUE(ChooseViews(start, city_, {}, {}, testing::TempDir(), &survey_).ok());
    vertices_ = start.vertices;
  }

  // Positions of a tile's vertices by global id.
  std::map<uint32_t, Vector3d> Refine(const CellRect& core, double halo_m, TilePackage* package) {
    package->tile = 0;
    *package = CutTile(city_, survey_, {{0, core}, halo_m, all_views_}).value();
    std::vector<TileView> views;
    for (size_t v = 0; v < package->views.size(); ++v) {
      const PosedCamera& camera = package->views[v].camera;
      const PixelRect rect = ProjectedBounds(package->mesh, camera, 32, 16);
      TileView view;
      view.view = static_cast<int>(v);
      view.window = {camera, rect};
      FloatImage luminance(rect.width(), rect.height());
      for (int y = 0; y < rect.height(); ++y) {
        for (int x = 0; x < rect.width(); ++x) {
          luminance.at(x, y) = scene_.pictures[v].at(rect.x0 + x, rect.y0 + y);
        }
      }
      view.pixels =
          std::make_shared<HeldPixels>(std::move(luminance), FloatImage(), TileSilhouettes(*package, view.window));
      views.push_back(std::move(view));
    }
    TileRefineOptions options;
    options.geometry.levels = {0};
    options.geometry.iterations = {2};
    options.geometry.smoothing_sweeps = 1;
    options.geometry.start_smoothing_steps = 1;
    options.geometry.thin_plate = 0.3;
    options.geometry.inter = 0.1;
    const TileResult result =
        RefineTile(*package, views, TileState(), options, TaskControl(), SystemClock()).value().result;
    std::map<uint32_t, Vector3d> moved;
    for (size_t v = 0; v < result.vertex_ids.size(); ++v) {
      moved.emplace(result.vertex_ids[v], result.positions[v]);
    }
    return moved;
  }

  TinyScene scene_;
  CityReader city_;
  std::vector<Vector3d> vertices_;
  Survey survey_;
  std::vector<int32_t> all_views_;
};

TEST_F(ExactTileTest, FarFromItsCutATileMovesAsTheCityDoes) {
  TilePackage whole, tile;
  const CellRect everything = {-100, -100, 100, 100};
  const auto expected = Refine(everything, 0, &whole);
  int same = 0, moved = 0, windows = 0;
  for (const CellRect& core : {CellRect{-5, -5, -1, 5}, CellRect{1, -5, 5, 5}, CellRect{-5, 1, 5, 5}}) {
    const auto found = Refine(core, 16, &tile);
    ASSERT_LT(tile.mesh.faces.size(), whole.mesh.faces.size());
    for (size_t v = 0; v < tile.views.size(); ++v) {
      windows += ProjectedBounds(tile.mesh, tile.views[v].camera, 0, 1) !=
                 ProjectedBounds(whole.mesh, whole.views[v].camera, 0, 1);
    }
    for (const auto& [id, position] : found) {
      // From the cut windows and the solver's rings reach far into the halo, but not past it.
      const Eigen::Vector2d at = tile.ground.Coordinates(vertices_[id]);
      if (DistanceToRect(at, core, tile.ground.cell_m) > 0) continue;
      moved += (position - vertices_[id]).norm() > 1e-4;
      same += position == expected.at(id);
      EXPECT_EQ(position, expected.at(id)) << "vertex " << id << " at " << at.transpose();
    }
  }
  EXPECT_GT(windows, 0) << "or no image was cropped";
  EXPECT_GT(moved, 100);
  EXPECT_GT(same, 100);
}

}  // namespace
}  // namespace tessera
