// Parameters of the tasks, as the plan writes them and the tasks read them. Each has one canonical JSON form, which
// enters the task's key.
#ifndef TESSERA_COMMON_TILE_TASK_PARAMETERS_H_
#define TESSERA_COMMON_TILE_TASK_PARAMETERS_H_

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/tile/ground.h"
#include "common/tile/method_settings.h"

namespace tessera {

// Names of the files that tasks hand on.
inline constexpr char kCityFile[] = "city.arrays";      // ingest: the repaired and split mesh
inline constexpr char kSurveyFile[] = "survey.json";    // ingest
inline constexpr char kTileFile[] = "tile.arrays";      // cut
inline constexpr char kViewsFile[] = "views.arrays";    // crop: what of the views' pixels sees the tile
inline constexpr char kResultFile[] = "result.arrays";  // refine
inline constexpr char kCoreFile[] = "core.arrays";      // stitch
inline constexpr char kMeshFile[] = "mesh.ply";         // publish
inline constexpr char kReportFile[] = "report.json";    // publish
inline constexpr char kTileMeshFolder[] = "tiles";      // publish, of more than one tile: a mesh each
inline constexpr char kTileIndexFile[] = "tiles/index.json";
inline constexpr char kSceneFolder[] = "scene";  // scene files among other inputs lie under this name

struct TileParameters {
  int tile = 0;
  CellRect core;
};

// A tile's input among those of stitch and publish: "0003/result.arrays".
std::string TileInputName(int tile, const std::string& file);

// What ingest needs to know of the method; without, it is done once for all methods.
struct IngestParameters {
  // Unset: the defaults.
  std::optional<int> partners;             // that a view chooses
  std::optional<int> views_per_direction;  // that a cell of the ground is refined from, at most
};

struct CutParameters {
  TileParameters tile;
  double halo_m = 0;
  std::vector<int32_t> views;  // indices in the survey, ascending
};

struct RefineParameters {
  int rounds = 0;  // 0: the default
  std::string method;
  MethodSettings settings = {};
  // Which of the steps (RefineStepsOf) are done here: [begin, end).
  int begin = 0, end = std::numeric_limits<int>::max();
  TileParameters tile = {};
  double blend_m = 0;  // the result holds what is so near the core; and as StitchParameters has it
  std::vector<TileParameters> results = {};  // of the steps before, this tile's too, ascending; none at the first
};

struct StitchParameters {
  TileParameters tile;
  double blend_m = 0;
  std::vector<TileParameters> results;  // tiles whose results are among the inputs, this one too, ascending
};

struct PublishParameters {
  std::vector<TileParameters> tiles;  // ascending
};

std::string ToJson(const IngestParameters& parameters);
std::string ToJson(const CutParameters& parameters);
std::string ToJson(const RefineParameters& parameters);
std::string ToJson(const StitchParameters& parameters);
std::string ToJson(const PublishParameters& parameters);

// INVALID_ARGUMENT if `json` lacks a parameter or has one of a wrong type.
StatusOr<IngestParameters> ParseIngestParameters(const std::string& json);
StatusOr<CutParameters> ParseCutParameters(const std::string& json);
StatusOr<RefineParameters> ParseRefineParameters(const std::string& json);
StatusOr<StitchParameters> ParseStitchParameters(const std::string& json);
StatusOr<PublishParameters> ParsePublishParameters(const std::string& json);

}  // namespace tessera

#endif  // TESSERA_COMMON_TILE_TASK_PARAMETERS_H_
