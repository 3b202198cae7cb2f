// The pixels that crop passes to the refinement steps.
#include <gtest/gtest.h>

#include <algorithm>

#include "common/imaging/image_io.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "common/storage/files.h"
#include "tests/support/in_process_line.h"
#include "tests/support/tiny_scene.h"
#include "worker/tile/tile_files.h"
#include "worker/tile/tile_views.h"

namespace tessera {
namespace {

// The tasks before the refinement.
StatusOr<TaskOutcome> UpToCrop(const TaskRequest& request) {
  if (request.kind == "measure" || request.kind == "mend") return absl::CancelledError("far enough");
  return RunTask(request, {});
}

struct Cropped {
  std::string folder;
  std::vector<TilePackage> packages;
  std::vector<std::string> paths;
  Survey survey;  // with the names of the scene's files, which packages do not contain
};

Cropped CropScene(const TinySceneOptions& options) {
  Cropped cropped;
  cropped.folder = FreshTestFolder("crops");
  WriteTinyScene(cropped.folder, options);
  const std::string work = cropped.folder + "/work";
  EXPECT_EQ(RunLine(cropped.folder, work, {.tiles = 2}, UpToCrop).status().code(), absl::StatusCode::kCancelled);
  cropped.survey = *ParseSurvey(*ReadFile(work + "/0/out/" + kSurveyFile));
  for (int tile = 0; tile < 2; ++tile) {  // task 0 is ingest, then cut and crop of each tile
    cropped.packages.push_back(*ReadTilePackage(work + "/" + std::to_string(1 + tile) + "/out/" + kTileFile));
    cropped.paths.push_back(work + "/" + std::to_string(3 + tile) + "/out/" + kViewsFile);
  }
  return cropped;
}

TEST(Crops, EqualTheImagesLoadedDirectly) {
  for (const auto kind : {TinySceneOptions::Likelihoods::kTiff, TinySceneOptions::Likelihoods::kNpy,
                          TinySceneOptions::Likelihoods::kLabelPng, TinySceneOptions::Likelihoods::kNone}) {
    TinySceneOptions options;
    options.likelihoods = kind;
    options.k1 = -0.05;
    const Cropped cropped = CropScene(options);
    for (size_t t = 0; t < 2; ++t) {
      const TilePackage& package = cropped.packages[t];
      const auto views = OpenTileViews(package, cropped.paths[t]);
      ASSERT_TRUE(views.ok()) << views.status();
      ASSERT_GT(views->size(), 1u);
      for (const RefineView& view : *views) {
        const SceneView& from = cropped.survey.views[package.view_ids[view.index]];
        const PixelRect& rect = view.pixels->rect();
        ASSERT_EQ(rect, package.view_rects[view.index]);
        const auto whole = ReadLuminance(cropped.folder + "/" + from.image_path, from.lens);
        const auto level = view.pixels->Level(0);
        ASSERT_TRUE(whole.ok() && level.ok());
        ASSERT_EQ(level->rect, rect);
        ASSERT_EQ(level->luminance.size(), level->pixels());
        for (int y = 0; y < rect.height(); ++y) {
          for (int x = 0; x < rect.width(); ++x) {
            const float expected = whole->at(rect.x0 + x, rect.y0 + y);
            ASSERT_EQ(level->luminance[static_cast<size_t>(y) * rect.width() + x], LuminanceCode(expected));
          }
        }
        ASSERT_EQ(view.pixels->has_likelihoods(), kind != TinySceneOptions::Likelihoods::kNone);
        if (!view.pixels->has_likelihoods()) continue;
        const auto part = ReadLikelihoodPart(cropped.folder + "/" + from.likelihood_path, 3, from.lens,
                                             {rect.x0, rect.y0, rect.x1, rect.y1});
        ASSERT_TRUE(part.ok());
        ASSERT_EQ(level->likelihoods.size(), part->pixels.data.size());
        for (size_t i = 0; i < level->likelihoods.size(); ++i) {
          ASSERT_NEAR(level->likelihoods[i] / Texels::kLikelihoodSteps, part->pixels.data[i], 0.5 / 255 + 1e-6);
        }
      }
    }
  }
}

// Each level is half of the previous one, as if computed in memory.
TEST(Crops, ContainAllPyramidLevels) {
  for (const bool coarse : {false, true}) {
    TinySceneOptions options;
    options.coarse_likelihoods = coarse;
    const Cropped cropped = CropScene(options);
    const auto views = OpenTileViews(cropped.packages[0], cropped.paths[0]);
    ASSERT_TRUE(views.ok()) << views.status();
    for (const RefineView& view : *views) {
      StatusOr<StoredTexels> last = view.pixels->Level(0);
      ASSERT_TRUE(last.ok());
      EXPECT_EQ(last->same_resolution, !coarse);
      for (int l = 1; l < kTexelLevels; ++l) {
        const auto level = view.pixels->Level(l);
        ASSERT_TRUE(level.ok()) << level.status();
        EXPECT_EQ(level->rect, last->Half().rect);
        EXPECT_TRUE(std::ranges::equal(level->luminance, last->HalfLuminance()));
        EXPECT_TRUE(coarse ? std::ranges::equal(level->likelihoods, last->likelihoods)
                           : std::ranges::equal(level->likelihoods, last->HalfLikelihoods()));
        last = level;
      }
    }
  }
}

TEST(Crops, DetectDamageAndCropsOfAnotherTile) {
  const Cropped cropped = CropScene({});
  EXPECT_EQ(OpenTileViews(cropped.packages[0], cropped.paths[1]).status().message(),
            cropped.paths[1] + ": found crops of tile 1, expected those of tile 0");
  std::string bytes = *ReadFile(cropped.paths[0]);
  bytes.back() ^= 1;  // of the last array
  const std::string path = cropped.folder + "/damaged.arrays";
  ASSERT_TRUE(WriteFileAtomic(path, bytes).ok());
  const auto views = OpenTileViews(cropped.packages[0], path);
  ASSERT_TRUE(views.ok()) << "values are verified on reading";
  EXPECT_TRUE(views->front().pixels->Level(0).ok());
  EXPECT_TRUE(views->back().pixels->Level(0).ok());
  EXPECT_EQ(views->back().pixels->Level(kTexelLevels - 1).status().code(), absl::StatusCode::kDataLoss);
  bytes.resize(bytes.size() / 2);
  ASSERT_TRUE(WriteFileAtomic(path, bytes).ok());
  EXPECT_EQ(OpenTileViews(cropped.packages[0], path).status().code(), absl::StatusCode::kDataLoss);
}

}  // namespace
}  // namespace tessera
