// Surveys of small cities for tests of planning.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "common/base/random.h"
#include "common/job/survey.h"
#include "server/tiling/tiling.h"

namespace tessera {

inline Survey RandomSurvey(int width, int height, double filled, uint64_t seed) {
  Random random(seed);
  Survey s;
  s.gsd_m = 0.1;
  s.ground = MakeGroundPlane(s.up, 8);
  s.views.resize(6);
  s.pairs = {{0, 1}, {1, 0}};
  for (size_t v = 0; v < s.views.size(); ++v) {
    s.views[v].image_path = "images/" + std::to_string(v) + ".jpg";
    if (v % 2 == 0) s.views[v].likelihood_path = "likelihoods/" + std::to_string(v) + ".tif";
  }
  s.classes.resize(2);
  for (int y = -3; y < height - 3; ++y) {
    for (int x = -5; x < width - 5; ++x) {
      if (random.Uniform() > filled) continue;
      SurveyCell cell;
      cell.x = x;
      cell.y = y;
      cell.faces = 1 + random.Below(2000);
      cell.reach_m = random.Uniform(0, 2);
      for (int v = 0; v < 6; ++v) {
        if (random.Uniform() < 0.4) cell.views.push_back(v);
      }
      s.cells.push_back(cell);
      s.faces += cell.faces;
    }
  }
  FillViewDepths(&s);
  return s;
}

inline std::vector<std::string> FilesOf(const Survey& survey) {
  std::vector<std::string> files = {"scene.json"};
  for (const SceneView& view : survey.views) {
    for (const std::string& path : {view.image_path, view.likelihood_path}) {
      if (!path.empty()) files.push_back(path);
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

inline std::vector<CellRect> Cores(const Survey& survey, int tiles) {
  TilingOptions options;
  options.tiles = tiles;
  options.effort = EffortOf({}, survey);
  const auto cores = LayOutTiles(CellIndex(survey), options);
  EXPECT_TRUE(cores.ok()) << cores.status();
  return *cores;
}

// Each view sees the whole city from above.
inline Survey SeenFromAbove(int size) {
  Survey survey = RandomSurvey(size, size, 1, 1);
  for (SceneView& view : survey.views) {
    view.camera.intrinsics = {8000, 8000, 8000, 8000, 4000, 4000};
    view.camera.rotation_cam_from_world.diagonal() << 1, -1, -1;
    view.camera.translation_cam_from_world.z() = 800;
  }
  for (SurveyCell& cell : survey.cells) {
    cell.box_min = {8.0 * cell.x, 8.0 * cell.y, 0};
    cell.box_max = {8.0 * cell.x + 8, 8.0 * cell.y + 8, 20};
  }
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) {
      if (i != j) survey.pairs.push_back({i, j});
    }
  }
  survey.has_likelihoods = true;
  FillViewDepths(&survey);
  return survey;
}

}  // namespace tessera
