// The pixels that crop hands to the steps.
#include <gtest/gtest.h>

#include <cmath>

#include "common/imaging/image_io.h"
#include "common/storage/files.h"
#include "common/tile/task_parameters.h"
#include "tests/support/in_process_line.h"
#include "tests/support/tiny_scene.h"
#include "worker/tasks/tile_files.h"
#include "worker/tasks/tile_views.h"

namespace tessera {
namespace {

// Those before the refinement.
StatusOr<TaskOutcome> UpToCrop(const TaskRequest& request) {
  if (request.kind == "measure" || request.kind == "mend") return absl::CancelledError("far enough");
  return RunTask(request, {});
}

struct Cropped {
  std::string folder;
  std::vector<TilePackage> packages;
  std::vector<std::string> paths;
};

Cropped CropScene(const TinySceneOptions& options) {
  Cropped cropped;
  cropped.folder = FreshTestFolder("crops");
  WriteTinyScene(cropped.folder, options);
  const std::string work = cropped.folder + "/work";
  EXPECT_EQ(RunLine(cropped.folder, work, {.tiles = 2}, UpToCrop).status().code(), absl::StatusCode::kCancelled);
  for (int tile = 0; tile < 2; ++tile) {  // task 0 is ingest, then the cuts, then the crops
    cropped.packages.push_back(*ReadTilePackage(work + "/" + std::to_string(1 + tile) + "/out/" + kTileFile));
    cropped.paths.push_back(work + "/" + std::to_string(3 + tile) + "/out/" + kViewsFile);
  }
  return cropped;
}

TEST(Crops, AreTheImagesAsTheDataTermHasThem) {
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
      for (const TileView& view : *views) {
        const SceneView& from = package.views[view.view];
        const PixelRect& rect = view.window.rect;
        ASSERT_EQ(rect, package.view_rects[view.view]);
        const auto whole = ReadLuminance(cropped.folder + "/" + from.image_path, from.lens);
        const auto luminance = view.pixels->Luminance();
        ASSERT_TRUE(whole.ok() && luminance.ok());
        ASSERT_EQ(luminance->width, rect.width());
        ASSERT_EQ(luminance->height, view.pixels->height());
        for (int y = 0; y < rect.height(); ++y) {
          for (int x = 0; x < rect.width(); ++x) {
            const float expected = whole->at(rect.x0 + x, rect.y0 + y), found = luminance->at(x, y);
            ASSERT_EQ(std::isnan(found), std::isnan(expected));
            if (std::isnan(found)) continue;
            ASSERT_NEAR(found, expected, 1.0 / 65534);
          }
        }
        ASSERT_EQ(view.pixels->has_likelihoods(), kind != TinySceneOptions::Likelihoods::kNone);
        if (!view.pixels->has_likelihoods()) continue;
        const auto part = ReadLikelihoodPart(cropped.folder + "/" + from.likelihood_path, 3, from.lens,
                                             {rect.x0, rect.y0, rect.x1, rect.y1});
        const auto likelihoods = view.pixels->Likelihoods();
        ASSERT_TRUE(part.ok() && likelihoods.ok());
        ASSERT_EQ(likelihoods->data.size(), part->pixels.data.size());
        for (size_t i = 0; i < likelihoods->data.size(); ++i) {
          ASSERT_NEAR(likelihoods->data[i], part->pixels.data[i], 0.5 / 255 + 1e-6);
        }
      }
    }
  }
}

TEST(Crops, DamageAndOtherTilesAreFound) {
  const Cropped cropped = CropScene({});
  EXPECT_EQ(OpenTileViews(cropped.packages[0], cropped.paths[1]).status().message(),
            cropped.paths[1] + ": found crops of tile 1, expected those of tile 0");
  std::string bytes = *ReadFile(cropped.paths[0]);
  bytes.back() ^= 1;  // of the last array
  const std::string path = cropped.folder + "/damaged.arrays";
  ASSERT_TRUE(WriteFileAtomic(path, bytes).ok());
  const auto views = OpenTileViews(cropped.packages[0], path);
  ASSERT_TRUE(views.ok()) << "values are looked at when they are read";
  EXPECT_TRUE(views->front().pixels->Luminance().ok());
  EXPECT_TRUE(views->back().pixels->Likelihoods().ok());
  EXPECT_EQ(views->back().pixels->Luminance().status().code(), absl::StatusCode::kDataLoss);
  bytes.resize(bytes.size() / 2);
  ASSERT_TRUE(WriteFileAtomic(path, bytes).ok());
  EXPECT_EQ(OpenTileViews(cropped.packages[0], path).status().code(), absl::StatusCode::kDataLoss);
}

}  // namespace
}  // namespace tessera
