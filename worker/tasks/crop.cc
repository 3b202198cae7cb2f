#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "common/job/task_parameters.h"
#include "worker/tasks/task_functions.h"
#include "worker/tile/tile_files.h"
#include "worker/tile/tile_views.h"

namespace tessera {

StatusOr<TaskOutcome> RunCrop(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const CropParameters parameters, ParseCropParameters(request.parameters));
  if (!parameters.coarse.empty() && parameters.coarse.size() != parameters.tiles.size()) {
    return absl::InvalidArgumentError(absl::StrCat("crop: found coarse crops of ", parameters.coarse.size(),
                                                   " tiles, expected those of ", parameters.tiles.size()));
  }
  ViewWindows windows;
  for (size_t i = 0; i < parameters.tiles.size(); ++i) {
    const std::string path = InputPath(request, TileInputName(parameters.tiles[i], kTileFile));
    TESSERA_ASSIGN_OR_RETURN(const TilePackage package, ReadTileViews(path));
    std::string coarse;
    if (!parameters.coarse.empty()) {
      coarse = InputPath(request, TileInputName(parameters.coarse.at(i), kViewsFile));
    }
    TESSERA_RETURN_IF_ERROR(AddWindows(package, coarse, &windows));
  }
  std::vector<std::string> files;
  for (const auto& [id, window] : windows.of_view) {
    files.insert(files.end(), {window.view.image_path, window.view.likelihood_path, window.view.mask_path});
  }
  TESSERA_RETURN_IF_ERROR(FetchInScene(request.input_dir, files, request.fetch));
  TESSERA_RETURN_IF_ERROR(CropViews(windows, request.input_dir, OutputPath(request, kViewsFile), control));
  TaskOutcome outcome;
  outcome.outputs = {kViewsFile};
  outcome.stats = nlohmann::json{{"views", windows.of_view.size()}, {"seconds", SecondsSince(clock, start_us)}}.dump();
  return outcome;
}

}  // namespace tessera
