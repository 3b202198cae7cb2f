// A tile's face maps equal those of the whole city at all pixels that the core's derivatives read, for any vertex
// motion within the bound.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <map>

#include "tests/support/draw_views.h"
#include "tests/unit/worker/tile/tiny_city.h"
#include "worker/photo/data_term.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

constexpr int kWindow_px = 11, kLevel = 2;
constexpr double kMotion_m = 2;

VisibleSetOptions Bounds() {
  return {kMotion_m, ReferenceMargin_px(kWindow_px, kLevel), TargetMargin_px(kLevel), 1 << kLevel};
}

TilePackage Cut(const TinyCity& tiny, const CellRect& core, const VisibleSetOptions& sight) {
  CutOptions options;
  options.motion_m = sight.motion_m;
  options.visible_set = sight;
  auto cut = CutTile(tiny.city, tiny.survey, {{0, core}, {core}}, options);
  EXPECT_TRUE(cut.ok()) << cut.status();
  return std::move(cut->package);
}

// Flags of an image's pixels.
struct Mask {
  int width, height;
  std::vector<uint8_t> flags;
  Mask(int w, int h) : width(w), height(h), flags(static_cast<size_t>(w) * h, 0) {}
  // Dilates the mask by `margin` rows and columns.
  Mask Grown(int margin) const { return GrownAlong(1, width, margin).GrownAlong(width, height, margin); }

 private:
  // Dilates along lines of `count` pixels with this stride.
  Mask GrownAlong(int stride, int count, int margin) const {
    Mask grown(width, height);
    for (size_t line = 0; line < flags.size() / count; ++line) {
      const size_t first = stride == 1 ? line * count : line;
      int last = -margin - 1;  // last flag up to the pixel that is `margin` ahead
      for (int i = -margin; i < count; ++i) {
        const int ahead = i + margin;
        if (ahead < count && flags[first + static_cast<size_t>(ahead) * stride]) last = ahead;
        if (i >= 0 && last >= i - margin) grown.flags[first + static_cast<size_t>(i) * stride] = 1;
      }
    }
    return grown;
  }
};

struct Comparison {
  int64_t same = 0, different = 0;
  size_t missing_faces = 0;  // of the city, not in the tile
};

// Moves every vertex randomly by at most `motion_m` and compares the tile's face maps with those of the whole city: at
// the pixels of the core's faces, in the margin around them, and where these are warped to in the partner views.
void Compare(const TinyCity& tiny, const TilePackage& city, const TilePackage& tile, double motion_m, Random* random,
             Comparison* comparison) {
  std::map<uint32_t, Vector3d> moved;
  for (size_t v = 0; v < city.vertex_ids.size(); ++v) {
    const Vector3d direction = Vector3d(random->Normal(), random->Normal(), random->Normal()).normalized();
    // Half of the vertices move by the maximum.
    moved[city.vertex_ids[v]] = city.mesh.vertices[v] + std::min(1.0, random->Uniform(0, 2)) * motion_m * direction;
  }
  const auto displaced = [&](const TilePackage& package) {
    TriangleMesh mesh = package.mesh;
    for (size_t v = 0; v < mesh.vertices.size(); ++v) mesh.vertices[v] = moved.at(package.vertex_ids[v]);
    return mesh;
  };
  const TriangleMesh city_mesh = displaced(city), tile_mesh = displaced(tile);
  std::map<uint32_t, uint8_t> regions;
  for (size_t f = 0; f < tile.face_ids.size(); ++f) regions[tile.face_ids[f]] = tile.regions[f];
  // Views selected for each face of the city.
  std::vector<const std::vector<int32_t>*> looking(city.face_ids.size());
  for (size_t c = 0; c < city.cell_at.size(); ++c) {
    for (uint32_t f = city.cells.face_begin[c]; f < city.cells.face_begin[c + 1]; ++f) looking[f] = &city.cell_views[c];
  }
  const VisibleSetOptions bounds = Bounds();
  std::vector<FaceMap> city_maps;
  std::vector<Mask> needed;
  for (size_t v = 0; v < tile.views.size(); ++v) {
    const int32_t of_city = static_cast<int32_t>(
        std::lower_bound(city.view_ids.begin(), city.view_ids.end(), tile.view_ids[v]) - city.view_ids.begin());
    city_maps.push_back(RasterizeFaces(city_mesh, tile.views[v].camera));
    const FaceMap& map = city_maps.back();
    Mask own(map.width, map.height);
    for (size_t i = 0; i < map.face.size(); ++i) {
      const int32_t f = map.face[i];
      if (f < 0 || !std::binary_search(looking[f]->begin(), looking[f]->end(), of_city)) continue;
      const auto region = regions.find(city.face_ids[f]);
      own.flags[i] = region != regions.end() && (region->second & kCoreRegion);
    }
    needed.push_back(own.Grown(bounds.reference_margin_px));
  }
  const std::vector<Mask> references = needed;
  std::vector<Mask> landed;
  for (const Mask& mask : needed) landed.emplace_back(mask.width, mask.height);
  for (const auto& [reference, other] : tile.pairs) {
    const FaceMap& map = city_maps[reference];
    const PosedCamera &from = tile.views[reference].camera, &to = tile.views[other].camera;
    for (int y = 0; y < map.height; ++y) {
      for (int x = 0; x < map.width; ++x) {
        const size_t i = static_cast<size_t>(y) * map.width + x;
        if (!references[reference].flags[i] || map.face[i] < 0) continue;
        const Vector3d p = to.Project(from.Centre() + map.depth[i] * from.Ray(x + 0.5, y + 0.5));
        if (!to.InImage(p)) continue;
        landed[other].flags[static_cast<size_t>(p.y()) * map.width + static_cast<size_t>(p.x())] = 1;
      }
    }
  }
  for (size_t v = 0; v < tile.views.size(); ++v) {
    const Mask about = landed[v].Grown(bounds.target_margin_px);
    for (size_t i = 0; i < about.flags.size(); ++i) needed[v].flags[i] |= about.flags[i];
    const PixelRect& window = tile.view_rects[v];
    const FaceMap& whole = city_maps[v];
    FaceMap part;
    if (!window.empty()) part = RasterizeFaces(tile_mesh, {tile.views[v].camera, window});
    for (int y = 0; y < whole.height; ++y) {
      for (int x = 0; x < whole.width; ++x) {
        const size_t i = static_cast<size_t>(y) * whole.width + x;
        if (!needed[v].flags[i]) continue;
        bool same = x >= window.x0 && x < window.x1 && y >= window.y0 && y < window.y1;
        if (same) {
          const size_t j = static_cast<size_t>(y - window.y0) * window.width() + (x - window.x0);
          const auto id = [](const TilePackage& package, int32_t face) {
            return face < 0 ? int64_t{-1} : int64_t{package.face_ids[face]};
          };
          same = id(city, whole.face[i]) == id(tile, part.face[j]) &&
                 std::memcmp(&whole.depth[i], &part.depth[j], sizeof(float)) == 0;
        }
        ++(same ? comparison->same : comparison->different);
      }
    }
  }
  comparison->missing_faces += tiny.mesh.faces.size() - tile.face_ids.size();
}

Comparison CompareTiles(const VisibleSetOptions& sight, double motion_m, int cases) {
  TinySceneOptions options;
  options.finer = 4;
  const TinyCity tiny = MakeTinyCity(options);
  const TilePackage city = Cut(tiny, AllCells(tiny.survey), Bounds());
  EXPECT_EQ(city.face_ids.size(), tiny.mesh.faces.size());
  Comparison comparison;
  for (int seed = 0; seed < cases; ++seed) {
    Random random(static_cast<uint64_t>(seed));
    // Small cores, so that the tile does not contain the whole test city.
    const CellRect all = AllCells(tiny.survey);
    const int x = all.x0 + static_cast<int>(random.Below(all.x1 - all.x0 - 1));
    const int y = all.y0 + static_cast<int>(random.Below(all.y1 - all.y0 - 1));
    const CellRect core = {x, y, x + 1 + static_cast<int>(random.Below(2)), y + 1 + static_cast<int>(random.Below(2))};
    Compare(tiny, city, Cut(tiny, core, sight), motion_m, &random, &comparison);
  }
  return comparison;
}

TEST(ExactTile, MapsEqualThoseOfTheCityForAnyVertexMotion) {
  const Comparison comparison = CompareTiles(Bounds(), kMotion_m, 12);
  EXPECT_EQ(comparison.different, 0);
  EXPECT_GT(comparison.same, 10000);
  EXPECT_GT(comparison.missing_faces, 0u) << "every tile contains the whole city";
}

// The test above fails for bounds that are too small.
TEST(ExactTile, MapsDifferWithSmallerBounds) {
  VisibleSetOptions still = Bounds();
  still.motion_m = 0;
  EXPECT_GT(CompareTiles(still, kMotion_m, 6).different, 0);
  EXPECT_EQ(CompareTiles(still, 0, 6).different, 0);
  VisibleSetOptions narrow = still;
  narrow.reference_margin_px = narrow.target_margin_px = 0;
  EXPECT_GT(CompareTiles(narrow, 0, 6).different, 0);
}

}  // namespace
}  // namespace tessera
