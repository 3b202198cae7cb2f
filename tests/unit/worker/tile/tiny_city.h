// The tiny scene as a city file of many blocks, with its survey and random tilings.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <string>
#include <vector>

#include "common/base/random.h"
#include "tests/support/tiny_scene.h"
#include "worker/city/cell_views.h"
#include "worker/city/city_file.h"
#include "worker/tile/cut_tile.h"

namespace tessera {

inline constexpr int64_t kTinyBlockFaces = 60;  // so that the city has many blocks

struct TinyCity {
  TriangleMesh mesh;  // of the whole city
  CityReader city;
  Survey survey;
};

inline TinyCity MakeTinyCity(const TinySceneOptions& options = {}) {
  TinyCity tiny;
  const TinyScene scene = MakeTinyScene(options);
  tiny.mesh = scene.mesh;
  std::vector<uint32_t> input_face(scene.mesh.faces.size());
  std::iota(input_face.begin(), input_face.end(), 0u);
  Survey& s = tiny.survey;
  s.gsd_m = 0.2 / options.finer;
  s.ground = MakeGroundPlane(s.up, 4);
  s.classes.resize(3);
  s.has_likelihoods = s.has_labels = true;
  for (size_t v = 0; v < scene.cameras.size(); ++v) {
    SceneView view;
    view.name = scene.image_names[v];
    view.camera = scene.cameras[v];
    view.lens.pinhole = view.camera.intrinsics;
    s.views.push_back(view);
    for (size_t w = 0; w < scene.cameras.size(); ++w) {
      // One partner per view, so that a tile does not contain all views as partners.
      if (w == (v ^ 1)) s.pairs.push_back({static_cast<int32_t>(v), static_cast<int32_t>(w)});
    }
  }
  s.faces = static_cast<int64_t>(scene.mesh.faces.size());
  s.cells = CellsOf(tiny.mesh, s.ground);
  const std::string path = FreshTestFolder("city") + "/city.arrays";
  const Status written =
      WriteCity(path, {tiny.mesh, input_face}, s.ground, s.cells, testing::TempDir(), kTinyBlockFaces);
  EXPECT_TRUE(written.ok()) << written;
  auto opened = CityReader::Open(path);
  EXPECT_TRUE(opened.ok()) << opened.status();
  tiny.city = *std::move(opened);
  const Status chosen = ChooseViews(tiny.mesh, tiny.city, {}, {}, testing::TempDir(), &s);
  EXPECT_TRUE(chosen.ok()) << chosen;
  FillViewDepths(&s);
  return tiny;
}

inline CellRect AllCells(const Survey& survey) {
  CellRect all = {1000, 1000, -1000, -1000};
  for (const SurveyCell& cell : survey.cells) {
    all = {std::min(all.x0, cell.x), std::min(all.y0, cell.y), std::max(all.x1, cell.x + 1),
           std::max(all.y1, cell.y + 1)};
  }
  return all;
}

// Cores between random rows and columns of cells; every core has faces.
inline std::vector<CellRect> RandomCores(const Survey& survey, Random* random) {
  const CellRect all = AllCells(survey);
  const auto cuts = [random](int low, int high) {
    std::vector<int> borders = {low};
    while (borders.back() < high) {
      borders.push_back(std::min<int>(high, borders.back() + 1 + static_cast<int>(random->Below(5))));
    }
    return borders;
  };
  std::vector<CellRect> cores;
  const std::vector<int> columns = cuts(all.x0, all.x1), rows = cuts(all.y0, all.y1);
  for (size_t r = 0; r + 1 < rows.size(); ++r) {
    for (size_t c = 0; c + 1 < columns.size(); ++c) {
      const CellRect core = {columns[c], rows[r], columns[c + 1], rows[r + 1]};
      const bool has = std::any_of(survey.cells.begin(), survey.cells.end(), [&](const SurveyCell& cell) {
        return core.Contains({cell.x, cell.y});
      });
      if (has) cores.push_back(core);
    }
  }
  return cores;
}

inline std::vector<CutResult> CutAll(const TinyCity& tiny, const std::vector<CellRect>& cores,
                                     const CutOptions& options, const MovedSpans* moved = nullptr) {
  std::vector<CutResult> cuts;
  for (size_t t = 0; t < cores.size(); ++t) {
    auto cut = CutTile(tiny.city, tiny.survey, {{static_cast<int>(t), cores[t]}, cores}, options, moved);
    EXPECT_TRUE(cut.ok()) << cut.status();
    cuts.push_back(*std::move(cut));
  }
  return cuts;
}

// Small dependency radii, so that not every tile contains the whole city.
inline CutOptions ShortReach() {
  CutOptions options;
  options.motion_m = 0.2;
  options.visible_set = {0.2, 3, 2, 1};
  options.radius.solve_rings = 2;
  options.radius.repair = {{1, 2}, 1};
  options.radius.contact_m = 0.3;
  options.radius.label = {1, 1, 1, 1};
  return options;
}

}  // namespace tessera
