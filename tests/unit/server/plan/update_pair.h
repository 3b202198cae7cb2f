// A base job and the survey of its update, for tests of planning.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "server/plan/update_base.h"
#include "server/plan/update_plan.h"
#include "tests/support/small_surveys.h"

namespace tessera {

inline Digest DigestOf(const std::string& content) {
  return {Sha256Hex(content), static_cast<int64_t>(content.size())};
}

// A base job with this number of tiles, and the survey of an update: a copy of the base's for tests to change.
struct Pair {
  Survey before, now;
  UpdateBase base;
  explicit Pair(int tiles) : before(SeenFromAbove(12)) {
    before.mesh_path = "mesh.ply";
    for (size_t v = 0; v < before.views.size(); ++v) {
      SceneView& view = before.views[v];
      view.name = "old" + std::to_string(v);
      view.image_content = "pixels" + std::to_string(v);
      if (!view.likelihood_path.empty()) view.likelihood_content = "likelihoods" + std::to_string(v);
    }
    now = before;
    base.name = "jobs/1";
    base.survey_json = SurveyToJson(before);
    base.survey = DigestOf(base.survey_json);
    base.city = DigestOf("city");
    for (const CellRect& core : Cores(before, tiles)) {
      base.tiles.push_back({static_cast<int>(base.tiles.size()), core});
      base.states.push_back(DigestOf("state" + std::to_string(base.tiles.size())));
    }
    for (const std::string& file : Files()) base.scene_files.push_back({file, DigestOf(file)});
  }
  std::vector<std::string> Files() const {
    std::vector<std::string> files = FilesOf(now);
    files.push_back("mesh.ply");
    std::sort(files.begin(), files.end());
    return files;
  }
  // Adds a new view, which the cell chooses in addition.
  int32_t AddView(size_t cell) {
    const auto view = static_cast<int32_t>(now.views.size());
    now.views.push_back(now.views[0]);
    now.views.back().name = "new" + std::to_string(view);
    now.views.back().image_path = "images/new" + std::to_string(view) + ".jpg";
    now.views.back().likelihood_path.clear();
    now.views.back().image_content = "new pixels";
    now.cells[cell].views.push_back(view);
    FillViewDepths(&now);
    return view;
  }
  // Removes the tile's cells, as if a new mesh had no faces there.
  void RemoveCellsOf(int tile) {
    if (!now.revision) now.revision.emplace();
    std::erase_if(now.cells, [&](const SurveyCell& cell) {
      const bool gone = base.tiles[tile].core.Contains({cell.x, cell.y});
      if (gone) now.revision->cells.push_back({cell.x, cell.y});
      return gone;
    });
    std::sort(now.revision->cells.begin(), now.revision->cells.end());
  }
  int TileOf(size_t cell) const {
    for (const TileParameters& tile : base.tiles) {
      if (tile.core.Contains({now.cells[cell].x, now.cells[cell].y})) return tile.tile;
    }
    return -1;
  }
  std::vector<int> Redone() const {
    const auto changes = FindChangedTiles({}, before, now, base.tiles, {});
    EXPECT_TRUE(changes.ok()) << changes.status();
    std::vector<int> redone;
    for (const TileChange& change : *changes) {
      if (!change.why.empty()) redone.push_back(change.tile.tile);
    }
    return redone;
  }
};

}  // namespace tessera
