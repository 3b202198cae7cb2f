// The pixels that crop passes to the refinement steps.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <map>

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
  std::string inputs, path;  // the input folder of the task that crops for both tiles, and its crops
  Survey survey;  // with the names of the scene's files, which packages do not contain
};

Cropped CropScene(const TinySceneOptions& options) {
  Cropped cropped;
  cropped.folder = FreshTestFolder("crops");
  WriteTinyScene(cropped.folder, options);
  const std::string work = cropped.folder + "/work";
  EXPECT_EQ(RunLine(cropped.folder, work, {.tiles = 2}, UpToCrop).status().code(), absl::StatusCode::kCancelled);
  cropped.survey = *ParseSurvey(*ReadFile(work + "/0/out/" + kSurveyFile));
  for (int tile = 0; tile < 2; ++tile) {  // task 0 is ingest, then the cut of each tile, then crop
    cropped.packages.push_back(*ReadTilePackage(work + "/" + std::to_string(1 + tile) + "/out/" + kTileFile));
  }
  cropped.inputs = work + "/3/in";
  cropped.path = work + "/3/out/" + kViewsFile;
  return cropped;
}

// Crops the windows of the package that the file `earlier` lacks. Returns the views.
std::vector<int32_t> Crop(const Cropped& scene, const TilePackage& package, const std::string& earlier,
                          const std::string& path) {
  ViewWindows windows;
  EXPECT_TRUE(AddWindows(package, earlier, &windows).ok());
  EXPECT_TRUE(CropViews(windows, scene.inputs, path, {}).ok());
  std::vector<int32_t> views;
  for (const auto& [view, window] : windows.of_view) views.push_back(view);
  return views;
}

// Whether both have the same luminance and likelihoods in the window of the first, on all levels.
void ExpectSamePixels(const ViewPixels& a, const ViewPixels& b) {
  ASSERT_EQ(a.has_likelihoods(), b.has_likelihoods());
  TexelShape window;
  window.rect = a.rect();
  for (int l = 0; l < kTexelLevels; ++l, window = window.Half()) {
    const auto of_a = a.Level(l), of_b = b.Level(l);
    ASSERT_TRUE(of_a.ok() && of_b.ok());
    const auto at = [](const StoredTexels& level, int x, int y) {
      return static_cast<size_t>(y - level.rect.y0) * level.rect.width() + (x - level.rect.x0);
    };
    for (int y = window.rect.y0; y < window.rect.y1; ++y) {
      for (int x = window.rect.x0; x < window.rect.x1; ++x) {
        const size_t i = at(*of_a, x, y), j = at(*of_b, x, y);
        ASSERT_EQ(of_a->luminance[i], of_b->luminance[j]);
        for (int c = 0; c < of_a->classes; ++c) {
          ASSERT_EQ(of_a->likelihoods[c * of_a->pixels() + i], of_b->likelihoods[c * of_b->pixels() + j]);
        }
      }
    }
  }
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
      const auto views = OpenTileViews(package, {cropped.path});
      ASSERT_TRUE(views.ok()) << views.status();
      ASSERT_GT(views->size(), 1u);
      for (const RefineView& view : *views) {
        const SceneView& from = cropped.survey.views[package.view_ids[view.index]];
        const PixelRect& rect = view.pixels->rect();
        ASSERT_EQ(rect, package.view_rects[view.index]);
        const auto whole = ReadLuminance(cropped.folder + "/" + from.image_path, from.lens);
        const auto level = view.pixels->Level(0);
        ASSERT_TRUE(whole.ok() && level.ok());
        const PixelRect& crop = level->rect;  // for both tiles
        ASSERT_TRUE(crop.x0 <= rect.x0 && crop.y0 <= rect.y0 && crop.x1 >= rect.x1 && crop.y1 >= rect.y1);
        ASSERT_EQ(level->luminance.size(), level->pixels());
        for (int y = 0; y < crop.height(); ++y) {
          for (int x = 0; x < crop.width(); ++x) {
            const float expected = whole->at(crop.x0 + x, crop.y0 + y);
            ASSERT_EQ(level->luminance[static_cast<size_t>(y) * crop.width() + x], LuminanceCode(expected));
          }
        }
        ASSERT_EQ(view.pixels->has_likelihoods(), kind != TinySceneOptions::Likelihoods::kNone);
        if (!view.pixels->has_likelihoods()) continue;
        const auto part = ReadLikelihoodPart(cropped.folder + "/" + from.likelihood_path, 3, from.lens,
                                             {crop.x0, crop.y0, crop.x1, crop.y1});
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
    const auto views = OpenTileViews(cropped.packages[0], {cropped.path});
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

// A view of several tiles is decoded once, for the smallest window with those of all.
TEST(Crops, OfSeveralTilesHaveEachViewOnce) {
  const Cropped cropped = CropScene({});
  std::map<int32_t, PixelRect> of_all;
  size_t of_both = 0;
  for (const TilePackage& package : cropped.packages) {
    for (size_t v = 0; v < package.views.size(); ++v) {
      const PixelRect& rect = package.view_rects[v];
      if (rect.empty()) continue;
      const auto [found, is_new] = of_all.try_emplace(package.view_ids[v], rect);
      of_both += !is_new;
      found->second = found->second.With(rect);
    }
  }
  EXPECT_GT(of_both, 0u);
  for (const TilePackage& package : cropped.packages) {
    const auto views = OpenTileViews(package, {cropped.path});
    ASSERT_TRUE(views.ok()) << views.status();
    for (const RefineView& view : *views) {
      EXPECT_EQ(view.pixels->rect(), package.view_rects[view.index]);
      EXPECT_EQ(view.pixels->Level(0)->rect, of_all.at(view.id));
    }
  }
}

// The fine part of a job needs other windows than the coarse part, of which it reads the crops.
TEST(Crops, OnlyWindowsThatEarlierCropsLackAreCropped) {
  const Cropped cropped = CropScene({});
  const TilePackage& package = cropped.packages[0];
  const std::string none = cropped.folder + "/none.arrays", earlier = cropped.folder + "/earlier.arrays",
                    rest = cropped.folder + "/rest.arrays", all = cropped.folder + "/all.arrays";
  const auto direct = OpenTileViews(package, {cropped.path});
  ASSERT_TRUE(direct.ok());
  EXPECT_TRUE(Crop(cropped, package, cropped.path, none).empty());
  const auto reused = OpenTileViews(package, {none, cropped.path});
  ASSERT_TRUE(reused.ok()) << reused.status();
  ASSERT_EQ(reused->size(), direct->size());

  const auto seen = std::find_if(package.view_rects.begin(), package.view_rects.end(),
                                 [](const PixelRect& rect) { return !rect.empty(); });
  const int32_t changed = package.view_ids[seen - package.view_rects.begin()];
  for (int side = 0; side < 4; ++side) {
    TilePackage smaller = package;
    PixelRect& rect = smaller.view_rects[seen - package.view_rects.begin()];
    int* const sides[] = {&rect.x0, &rect.y0, &rect.x1, &rect.y1};
    *sides[side] += side < 2 ? 8 : -8;
    EXPECT_EQ(Crop(cropped, smaller, "", earlier).size(), direct->size());
    EXPECT_EQ(Crop(cropped, package, earlier, rest), std::vector<int32_t>{changed});
    const auto views = OpenTileViews(package, {rest, earlier});
    ASSERT_TRUE(views.ok()) << views.status();
    ASSERT_EQ(views->size(), direct->size());
    for (size_t v = 0; v < views->size(); ++v) {
      EXPECT_EQ((*views)[v].id, (*direct)[v].id);
      ExpectSamePixels(*(*views)[v].pixels, *(*direct)[v].pixels);
    }
    const Status missing = OpenTileViews(package, {earlier}).status();
    EXPECT_EQ(missing.code(), absl::StatusCode::kDataLoss);
    EXPECT_EQ(missing.message(),
              earlier + ": found no crop of view " + std::to_string(changed) + " with the pixels that tile 0 needs");
  }
}

// Windows that are far apart in an image would together take more than both.
TEST(Crops, WindowsFarApartStayTwo) {
  const Cropped cropped = CropScene({});
  TilePackage package = cropped.packages[0];
  const size_t v = std::find_if(package.view_rects.begin(), package.view_rects.end(),
                                [](const PixelRect& rect) { return !rect.empty(); }) -
                   package.view_rects.begin();
  const PinholeCamera& camera = package.views[v].camera.intrinsics;
  const PixelRect first = {0, 0, 16, 16}, last = {camera.width - 16, camera.height - 16, camera.width, camera.height},
                  middle = {0, 0, camera.width, camera.height};
  ViewWindows windows;
  const auto rects = [&](const PixelRect& added) {
    package.view_rects.assign(package.views.size(), {});
    package.view_rects[v] = added;
    EXPECT_TRUE(AddWindows(package, "", &windows).ok());
    std::vector<PixelRect> found;
    for (const auto& [view, window] : windows.of_view) found.push_back(window.rect);
    return found;
  };
  EXPECT_EQ(rects(first), std::vector<PixelRect>{first});
  EXPECT_EQ(rects(last), (std::vector<PixelRect>{first, last}));
  const std::string path = cropped.folder + "/apart.arrays";
  ASSERT_TRUE(CropViews(windows, cropped.inputs, path, {}).ok());
  const auto views = OpenTileViews(package, {path});
  ASSERT_TRUE(views.ok()) << views.status();
  ASSERT_EQ(views->size(), 1u);
  EXPECT_EQ(views->front().pixels->Level(0)->rect, last);
  EXPECT_EQ(rects(middle), std::vector<PixelRect>{middle});
}

// The task of the fine part asks for the files of the views of which the coarse part lacks pixels, and for no others.
TEST(Crops, MissingWindowsAreFetchedOnDemand) {
  TinySceneOptions options;
  options.likelihoods = TinySceneOptions::Likelihoods::kTiff;
  const Cropped cropped = CropScene(options);
  const TilePackage& package = cropped.packages[0];
  TilePackage smaller = package;
  const size_t v = std::find_if(package.view_rects.begin(), package.view_rects.end(),
                                [](const PixelRect& rect) { return !rect.empty(); }) -
                   package.view_rects.begin();
  smaller.view_rects[v].x1 -= 8;
  TaskRequest request = {kCropKind, R"({"coarse":[0],"tiles":[0]})", cropped.folder + "/in", cropped.folder + "/out"};
  for (const std::string& folder : {request.input_dir + "/0000", request.input_dir + "/views", request.output_dir}) {
    ASSERT_TRUE(EnsureFolder(folder).ok());
  }
  ASSERT_TRUE(WriteTilePackage(request.input_dir + "/0000/" + kTileFile, package).ok());
  Crop(cropped, smaller, "", request.input_dir + "/0000/" + kViewsFile);
  std::vector<std::string> asked;
  request.fetch = [&](const std::vector<std::string>& paths) -> Status {
    for (const std::string& path : paths) {
      asked.push_back(path.substr(request.input_dir.size() + 1));
      std::filesystem::copy(cropped.inputs + "/" + asked.back(), path);
    }
    return absl::OkStatus();
  };
  const auto outcome = RunTask(request, {});
  ASSERT_TRUE(outcome.ok()) << outcome.status();
  const int32_t view = package.view_ids[v];
  EXPECT_EQ(asked, (std::vector<std::string>{ViewFileName(view, false), ViewFileName(view, true)}));
  const auto views =
      OpenTileViews(package, {request.output_dir + "/" + kViewsFile, request.input_dir + "/0000/" + kViewsFile});
  const auto direct = OpenTileViews(package, {cropped.path});
  ASSERT_TRUE(views.ok() && direct.ok()) << views.status();
  ASSERT_EQ(views->size(), direct->size());
  for (size_t i = 0; i < views->size(); ++i) ExpectSamePixels(*(*views)[i].pixels, *(*direct)[i].pixels);
}

TEST(Crops, DetectDamageAndCropsOfAnotherTile) {
  const Cropped cropped = CropScene({});
  TilePackage other = cropped.packages[0];
  other.tile = 7;
  EXPECT_EQ(OpenTileViews(other, {cropped.path}).status().message(),
            cropped.path + ": found crops of tiles 0, 1, expected those of tile 7");
  const std::string path = cropped.folder + "/damaged.arrays";
  Crop(cropped, cropped.packages[0], "", path);
  std::string bytes = *ReadFile(path);
  bytes.back() ^= 1;  // of the last array
  ASSERT_TRUE(WriteFileAtomic(path, bytes).ok());
  const auto views = OpenTileViews(cropped.packages[0], {path});
  ASSERT_TRUE(views.ok()) << "values are verified on reading";
  EXPECT_TRUE(views->front().pixels->Level(0).ok());
  EXPECT_TRUE(views->back().pixels->Level(0).ok());
  EXPECT_EQ(views->back().pixels->Level(kTexelLevels - 1).status().code(), absl::StatusCode::kDataLoss);
  bytes.resize(bytes.size() / 2);
  ASSERT_TRUE(WriteFileAtomic(path, bytes).ok());
  EXPECT_EQ(OpenTileViews(cropped.packages[0], {path}).status().code(), absl::StatusCode::kDataLoss);
  ViewWindows windows;
  EXPECT_EQ(AddWindows(cropped.packages[0], path, &windows).code(), absl::StatusCode::kDataLoss);
}

}  // namespace
}  // namespace tessera
