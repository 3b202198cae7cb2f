// Content of packages, and the tiles whose states and sums a tile reads.
#include "worker/tile/cut_tile.h"

#include <gtest/gtest.h>

#include <map>
#include <set>
#include <span>

#include "common/geometry/csr_rows.h"
#include "common/geometry/edge_list.h"
#include "common/storage/files.h"
#include "tests/unit/worker/tile/tiny_city.h"
#include "worker/refine/descent.h"

namespace tessera {
namespace {

using Eigen::AlignedBox3d;
using Eigen::Vector3d;

std::vector<uint8_t> InCore(const TinyCity& tiny, const CellRect& core) {
  std::vector<uint8_t> flags;
  for (size_t f = 0; f < tiny.mesh.faces.size(); ++f) {
    flags.push_back(core.Contains(tiny.survey.ground.Cell(MeshSpans(tiny.mesh).Centroid(f))));
  }
  return flags;
}

// Calls body(tile, cores, its cut) for each tile of random tilings.
template <class Body>
void ForTiles(const TinyCity& tiny, const CutOptions& options, int tilings, const Body& body,
              const MovedSpans* moved = nullptr) {
  for (int seed = 0; seed < tilings; ++seed) {
    Random random(static_cast<uint64_t>(seed));
    const std::vector<CellRect> cores = RandomCores(tiny.survey, &random);
    const std::vector<CutResult> cuts = CutAll(tiny, cores, options, moved);
    for (size_t t = 0; t < cuts.size(); ++t) body(t, cores, cuts[t]);
  }
}

// Global ids of the package's faces in a region.
std::set<uint32_t> FacesWith(const TilePackage& package, uint8_t bit) {
  std::set<uint32_t> faces;
  for (size_t f = 0; f < package.face_ids.size(); ++f) {
    if (package.regions[f] & bit) faces.insert(package.face_ids[f]);
  }
  return faces;
}

void ExpectHas(const std::set<uint32_t>& faces, const std::vector<uint8_t>& wanted, const char* what) {
  for (uint32_t f = 0; f < wanted.size(); ++f) {
    EXPECT_TRUE(!wanted[f] || faces.contains(f)) << what << " lacks face " << f;
  }
}

TEST(CutTile, PackagesHaveCommonElementsInTheSameOrder) {
  const TinyCity tiny = MakeTinyCity();
  const GroundPlane ground = PackageCells(tiny.survey.ground);
  size_t smaller = 0;
  ForTiles(tiny, ShortReach(), 4, [&](size_t, const std::vector<CellRect>&, const CutResult& cut) {
    const TilePackage& p = cut.package;
    smaller += p.face_ids.size() < tiny.mesh.faces.size();
    // By y of the cell, its x, and the id.
    using Key = std::array<int64_t, 3>;
    std::vector<Key> faces, vertices;
    for (size_t f = 0; f < p.face_ids.size(); ++f) {
      const Eigen::Vector2i cell = ground.Cell(MeshSpans(tiny.mesh).Centroid(p.face_ids[f]));
      faces.push_back({cell.y(), cell.x(), p.face_ids[f]});
      for (int k = 0; k < 3; ++k) EXPECT_EQ(p.vertex_ids[p.mesh.faces[f][k]], tiny.mesh.faces[p.face_ids[f]][k]);
      EXPECT_EQ(p.mesh.labels[f], tiny.mesh.labels[p.face_ids[f]]);
    }
    for (size_t v = 0; v < p.vertex_ids.size(); ++v) {
      EXPECT_EQ(p.mesh.vertices[v], tiny.mesh.vertices[p.vertex_ids[v]]);
      const Eigen::Vector2i cell = ground.Cell(p.mesh.vertices[v]);
      vertices.push_back({cell.y(), cell.x(), p.vertex_ids[v]});
    }
    for (const std::vector<Key>& keys : {faces, vertices}) {
      EXPECT_TRUE(std::adjacent_find(keys.begin(), keys.end(), std::greater_equal<>()) == keys.end());
    }
    ASSERT_EQ(p.cells.face_begin.size(), p.cell_at.size() + 1);
    ASSERT_EQ(p.cells.vertex_begin.size(), p.cell_at.size() + 1);
    for (size_t c = 0; c < p.cell_at.size(); ++c) {
      for (uint32_t f = p.cells.face_begin[c]; f < p.cells.face_begin[c + 1]; ++f) {
        EXPECT_EQ(p.cell_at[c],
                  (std::array<int32_t, 2>{static_cast<int32_t>(faces[f][1]), static_cast<int32_t>(faces[f][0])}));
      }
      for (uint32_t v = p.cells.vertex_begin[c]; v < p.cells.vertex_begin[c + 1]; ++v) {
        EXPECT_EQ(p.cell_at[c],
                  (std::array<int32_t, 2>{static_cast<int32_t>(vertices[v][1]), static_cast<int32_t>(vertices[v][0])}));
      }
    }
  });
  EXPECT_GT(smaller, 0u) << "no package is smaller than the city";
}

// Compares with regions computed step by step on the whole city, for faces that touch at `positions`.
void CompareRegions(const TinyCity& tiny, const CutOptions& options, const std::vector<Vector3d>& positions,
                    const MovedSpans* moved) {
  const TriangleMesh& mesh = tiny.mesh;
  const CsrRows faces_of_vertex = FacesOfVertices(mesh);
  const RegionDependencyRadius& reach = options.radius;
  std::vector<AlignedBox3d> boxes(mesh.faces.size());
  for (size_t f = 0; f < boxes.size(); ++f) {
    for (const uint32_t v : mesh.faces[f]) boxes[f].extend(positions[v]);
  }
  const auto touching = [&](std::vector<uint8_t> faces) {
    const std::vector<uint8_t> before = faces;
    for (size_t f = 0; f < faces.size(); ++f) {
      for (size_t g = 0; g < faces.size() && !faces[f]; ++g) {
        if (before[g] && boxes[f].exteriorDistance(boxes[g]) <= reach.contact_m) faces[f] = 1;
      }
    }
    return faces;
  };
  std::vector<std::array<uint32_t, 2>> links;
  for (const MeshEdge& edge : EdgeList(mesh.faces)) {
    if (edge.left >= 0 && edge.right >= 0) {
      links.push_back({static_cast<uint32_t>(edge.left), static_cast<uint32_t>(edge.right)});
    }
  }
  std::vector<Cell> cell;
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    cell.push_back(LabelCellOf(tiny.survey.ground, tiny.survey.gsd_m, MeshSpans(mesh).Centroid(f)));
  }
  ForTiles(
      tiny, options, 3,
      [&](size_t t, const std::vector<CellRect>& cores, const CutResult& cut) {
        const std::vector<uint8_t> core = InCore(tiny, cores[t]);
        const std::set<uint32_t> own = FacesWith(cut.package, kCoreRegion);
        EXPECT_EQ(own.size(), static_cast<size_t>(std::count(core.begin(), core.end(), 1)));
        ExpectHas(own, core, "core");
        // Vertices at most `solve_rings` edges from the core, with all their faces.
        std::vector<uint8_t> vertices(mesh.vertices.size(), 0);
        for (size_t f = 0; f < core.size(); ++f) {
          for (const uint32_t v : mesh.faces[f]) vertices[v] |= core[f];
        }
        const auto faces_about = [&] {
          std::vector<uint8_t> faces(mesh.faces.size(), 0);
          for (size_t f = 0; f < faces.size(); ++f) {
            for (const uint32_t v : mesh.faces[f]) faces[f] |= vertices[v];
          }
          return faces;
        };
        for (int ring = 0; ring < reach.solve_rings; ++ring) {
          const std::vector<uint8_t> faces = faces_about();
          for (size_t f = 0; f < faces.size(); ++f) {
            for (const uint32_t v : mesh.faces[f]) vertices[v] |= faces[f];
          }
        }
        ExpectHas(FacesWith(cut.package, kSolveRegion), faces_about(), "solve");
        std::vector<uint8_t> mend = core;
        GrowRings(mesh, faces_of_vertex, 1, &mend);
        for (const int rings : reach.repair.rings) {
          GrowRings(mesh, faces_of_vertex, rings, &mend);
          mend = touching(mend);
        }
        GrowRings(mesh, faces_of_vertex, reach.repair.start_rings, &mend);
        ExpectHas(FacesWith(cut.package, kRepairRegion), mend, "mend");
        ExpectHas(FacesWith(cut.package, kLabelRegion), FacesInDependencyRadius(links, cell, core, reach.label),
                  "label");
      },
      moved);
}

TEST(CutTile, RegionsContainAllFacesThatTheOperatorsRead) {
  const TinyCity tiny = MakeTinyCity();
  CompareRegions(tiny, ShortReach(), tiny.mesh.vertices, nullptr);
}

// A surface of which a part left the start, as far as it may, so that it lies over another part.
struct MovedSurface {
  std::vector<Vector3d> positions;
  std::vector<AlignedBox3d> boxes;
  MovedSurface(const TinyCity& tiny, double motion_m) {
    for (const Vector3d& start : tiny.mesh.vertices) {
      positions.push_back(start + Vector3d(start.x() > 1 ? -0.99 * motion_m : 0, 0, 0));
    }
    boxes.resize(tiny.survey.cells.size());
    for (const Triangle& face : tiny.mesh.faces) {
      const Vector3d centroid =
          (tiny.mesh.vertices[face[0]] + tiny.mesh.vertices[face[1]] + tiny.mesh.vertices[face[2]]) / 3;
      const Eigen::Vector2i at = tiny.survey.ground.Cell(centroid);
      for (size_t c = 0; c < boxes.size(); ++c) {
        if (tiny.survey.cells[c].x != at.x() || tiny.survey.cells[c].y != at.y()) continue;
        for (const uint32_t v : face) boxes[c].extend(positions[v]);
      }
    }
  }
  MovedSpans spans() const { return {positions, {}, {}, boxes, {}}; }
};

// In the fine part of a job, faces may touch where the coarse part moved them.
TEST(CutTile, RegionsContainTheFacesThatTouchOnTheMovedSurface) {
  TinyCity tiny = MakeTinyCity();
  for (SurveyCell& cell : tiny.survey.cells) cell.views.clear();  // so that only regions make the cut read blocks
  CutOptions options = ShortReach();
  options.motion_m = 9;
  options.radius.contact_m = 0.1;
  const MovedSurface surface(tiny, options.motion_m);
  const MovedSpans moved = surface.spans();
  CompareRegions(tiny, options, surface.positions, &moved);
}

// The visible set is that of the moved boxes.
TEST(CutTile, VisibleCellsAreThoseOfTheMovedSurface) {
  const TinyCity tiny = MakeTinyCity();
  CutOptions options = ShortReach();
  options.motion_m = 3;
  const MovedSurface surface(tiny, options.motion_m);
  const MovedSpans moved = surface.spans();
  size_t others = 0;
  ForTiles(
      tiny, options, 2,
      [&](size_t t, const std::vector<CellRect>& cores, const CutResult& cut) {
        const std::set<uint32_t> sample = FacesWith(cut.package, kSampleRegion);
        std::vector<uint8_t> measured(tiny.survey.cells.size());
        for (size_t c = 0; c < measured.size(); ++c) {
          const SurveyCell& cell = tiny.survey.cells[c];
          measured[c] = cores[t].Contains({cell.x, cell.y});
          for (const uint32_t f : sample) {
            const Eigen::Vector2i at = tiny.survey.ground.Cell(MeshSpans(tiny.mesh).Centroid(f));
            measured[c] |= at.x() == cell.x && at.y() == cell.y;
          }
        }
        const auto windows = [&](std::span<const AlignedBox3d> boxes) {
          return FindVisibleSet(tiny.survey, measured, cut.package.view_ids, options.visible_set, boxes).windows;
        };
        EXPECT_EQ(cut.package.view_rects, windows(surface.boxes));
        others += cut.package.view_rects != windows({});
      },
      &moved);
  EXPECT_GT(others, 0u);
}

TEST(CutTile, FlagsExactlyTheVerticesThatLackFaces) {
  const TinyCity tiny = MakeTinyCity();
  const TriangleMesh& mesh = tiny.mesh;
  const CsrRows faces_of_vertex = FacesOfVertices(mesh);
  int64_t cut_off = 0;
  ForTiles(tiny, ShortReach(), 4, [&](size_t, const std::vector<CellRect>&, const CutResult& cut) {
    const TilePackage& p = cut.package;
    for (const uint8_t bit : {kCoreRegion, kSolveRegion, kRepairRegion, kLabelRegion}) {
      const std::set<uint32_t> faces = FacesWith(p, bit);
      for (size_t v = 0; v < p.vertex_ids.size(); ++v) {
        size_t in = 0, all = 0;
        for (const uint32_t f : faces_of_vertex[p.vertex_ids[v]]) {
          ++all;
          in += faces.contains(f);
        }
        EXPECT_EQ((p.cut_regions[v] & bit) != 0, in > 0 && in < all) << "vertex " << p.vertex_ids[v];
        cut_off += in > 0 && in < all;
      }
    }
  });
  EXPECT_GT(cut_off, 0);
}

TEST(CutTile, ReadsAllTilesWhoseCellsItNeeds) {
  const TinyCity tiny = MakeTinyCity();
  const Survey& survey = tiny.survey;
  const CutOptions options = ShortReach();
  size_t unread = 0, sampled = 0;
  ForTiles(tiny, options, 4, [&](size_t t, const std::vector<CellRect>& cores, const CutResult& cut) {
    const auto tiles_of = [&](const std::set<std::array<int, 2>>& cells) {
      std::vector<int> tiles;
      for (size_t other = 0; other < cores.size(); ++other) {
        const bool needed = std::any_of(cells.begin(), cells.end(), [&](const std::array<int, 2>& at) {
          return cores[other].Contains({at[0], at[1]});
        });
        if (needed) tiles.push_back(static_cast<int>(other));
      }
      return tiles;
    };
    const auto cells_of = [&](uint8_t bit) {
      std::set<std::array<int, 2>> cells;
      for (const uint32_t f : FacesWith(cut.package, bit)) {
        const Eigen::Vector2i at = survey.ground.Cell(MeshSpans(tiny.mesh).Centroid(f));
        cells.insert({at.x(), at.y()});
      }
      return cells;
    };
    EXPECT_EQ(cut.reads.solve, tiles_of(cells_of(kSolveRegion)));
    EXPECT_EQ(cut.reads.repair, tiles_of(cells_of(kRepairRegion)));
    EXPECT_EQ(cut.reads.label, tiles_of(cells_of(kLabelRegion)));
    // The sample is one cell adjacent to the core, with all its views.
    const std::set<std::array<int, 2>> sample = cells_of(kSampleRegion);
    EXPECT_LE(sample.size(), 1u);
    sampled += sample.size();
    const std::set<int32_t> views(cut.package.view_ids.begin(), cut.package.view_ids.end());
    // The package contains the core, the sample and the visible set.
    std::vector<uint8_t> measured;
    for (const SurveyCell& cell : survey.cells) {
      const bool in_sample = sample.contains({cell.x, cell.y});
      measured.push_back(in_sample || cores[t].Contains({cell.x, cell.y}));
      if (!in_sample) continue;
      EXPECT_FALSE(cores[t].Contains({cell.x, cell.y}));
      EXPECT_EQ(DistanceBetween({cell.x, cell.y, cell.x + 1, cell.y + 1}, cores[t], 1), 0);
      EXPECT_TRUE(std::includes(views.begin(), views.end(), cell.views.begin(), cell.views.end()));
    }
    const VisibleSet sight = FindVisibleSet(survey, measured, cut.package.view_ids, options.visible_set);
    std::set<std::array<int, 2>> in_sight;
    for (size_t c = 0; c < measured.size(); ++c) {
      if (sight.cells[c] || measured[c]) in_sight.insert({survey.cells[c].x, survey.cells[c].y});
    }
    EXPECT_EQ(cut.reads.visibility, tiles_of(in_sight));
    EXPECT_EQ(cut.package.view_rects, sight.windows);
    std::set<uint32_t> held(cut.package.face_ids.begin(), cut.package.face_ids.end());
    for (uint32_t f = 0; f < tiny.mesh.faces.size(); ++f) {
      const Eigen::Vector2i at = survey.ground.Cell(MeshSpans(tiny.mesh).Centroid(f));
      EXPECT_TRUE(held.contains(f) || !in_sight.contains({at.x(), at.y()}));
    }
    for (const std::vector<int>* reads :
         {&cut.reads.label, &cut.reads.repair, &cut.reads.visibility, &cut.reads.solve}) {
      EXPECT_TRUE(std::binary_search(reads->begin(), reads->end(), static_cast<int>(t)));
      unread += cores.size() - reads->size();
    }
  });
  EXPECT_GT(unread, 0u) << "every tile reads all others";
  EXPECT_GT(sampled, 0u);
}

// A cut reads the survey of the whole city. Changes outside the tile's visible set must not change its outputs, or an
// update would also repeat the crops and steps of unchanged tiles.
TEST(CutTile, ChangesOutsideTheVisibleCellsHaveNoEffect) {
  const TinyCity tiny = MakeTinyCity();
  TinyCity other = MakeTinyCity();
  // A new flight over one corner, whose views that cell chooses in addition.
  SurveyCell& changed = other.survey.cells.front();
  ASSERT_FALSE(changed.views.empty());
  const auto first_new = static_cast<int32_t>(other.survey.views.size());
  for (int i = 0; i < 2; ++i) {
    other.survey.views.push_back(other.survey.views[changed.views.front()]);
    other.survey.views.back().image_content = "new";
  }
  for (int i = 0; i < 2; ++i) changed.views.push_back(first_new + i);
  other.survey.pairs.push_back({first_new, first_new + 1});
  other.survey.scene_name = "another";
  FillViewDepths(&other.survey);
  const auto bytes = [](const CutResult& cut) {
    const std::string path = FreshTestFolder("package") + "/tile.arrays";
    EXPECT_TRUE(WriteTilePackage(path, cut.package).ok());
    return *ReadFile(path) + ToJson(cut.reads);
  };
  int same = 0, different = 0;
  for (int seed = 0; seed < 4; ++seed) {
    Random random(static_cast<uint64_t>(seed));
    const std::vector<CellRect> cores = RandomCores(tiny.survey, &random);
    const std::vector<CutResult> before = CutAll(tiny, cores, ShortReach()), now = CutAll(other, cores, ShortReach());
    for (size_t t = 0; t < cores.size(); ++t) {
      const bool touched = now[t].package.view_ids.back() >= first_new;
      (touched ? different : same) += 1;
      EXPECT_EQ(bytes(before[t]) == bytes(now[t]), !touched) << "seed " << seed << ", tile " << t;
    }
  }
  EXPECT_GT(same, 0) << "all tiles contain the corner";
  EXPECT_GT(different, 0);
}

TEST(CutTile, CoreWithoutFacesIsRejected) {
  const TinyCity tiny = MakeTinyCity();
  const CellRect far = {1000, 1000, 1001, 1001};
  const auto cut = CutTile(tiny.city, tiny.survey, {{0, far}, {far}}, ShortReach());
  EXPECT_EQ(cut.status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace tessera
