// Parameters of the tasks, as the plan writes them and the tasks read them. Each has one canonical JSON form, which
// enters the task's key.
#ifndef TESSERA_COMMON_JOB_TASK_PARAMETERS_H_
#define TESSERA_COMMON_JOB_TASK_PARAMETERS_H_

#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/job/ground.h"
#include "common/job/method_settings.h"

namespace tessera {

// Names of the files that tasks hand on.
inline constexpr char kCityFile[] = "city.arrays";             // ingest: the repaired and split mesh
inline constexpr char kSurveyFile[] = "survey.json";           // ingest
inline constexpr char kPlainSurveyFile[] = "plain.json";       // ingest: the survey without names, which tasks read
inline constexpr char kBaseSurveyFile[] = "base-survey.json";  // of the job that an update goes on from
inline constexpr char kFilesFile[] = "files.json";             // where files are that an update does not read
inline constexpr char kUpdateFile[] = "update.json";  // an update's plan: what is redone, why, and what it takes
inline constexpr char kTileFile[] = "tile.arrays";    // cut
inline constexpr char kViewsFile[] = "views.arrays";  // crop: what of the views' pixels sees the tile
inline constexpr char kReadsFile[] = "reads.json";    // cut: which other tiles this one reads
inline constexpr char kSumsFile[] = "sums.arrays";    // measure: the data term's sums over the core's faces
inline constexpr char kStateFile[] = "state.arrays";  // solve, mend, refine: positions and labels of the core
inline constexpr char kMeshFile[] = "mesh.ply";       // publish
inline constexpr char kReportFile[] = "report.json";  // publish
inline constexpr char kTileMeshFolder[] = "tiles";    // publish, of more than one tile: a mesh each
inline constexpr char kTileIndexFile[] = "tiles/index.json";
inline constexpr char kSceneFolder[] = "scene";  // scene files among other inputs lie under this name
// Among the files of a job's scene, though it lies among the blobs: the trained classifier (common/classify/model.h).
inline constexpr char kClassifierFile[] = ".classifier";
inline constexpr char kBordersFile[] = "borders.json";  // borders: how far borders of likelihoods can be trusted
// changes: faces of an update's result that show what is gone
inline constexpr char kOutdatedFile[] = "outdated.arrays";

// A view's file among the inputs of crop, however it is called in the scene. Those of likelihoods end so.
inline constexpr char kLikelihoodsEnding[] = ".likelihoods";
std::string ViewFileName(int32_t view, bool likelihoods);
// What classify counts about the borders of a view's likelihoods.
std::string ViewBordersName(int32_t view);

struct TileParameters {
  int tile = 0;
  CellRect core;
};

// A tile's input among those of a task that reads several tiles': "0003/state.arrays".
std::string TileInputName(int tile, const std::string& file);

// What ingest needs to know of the method; without, it is done once for all methods.
struct IngestParameters {
  // Unset: the defaults.
  std::optional<int> partners;             // that a view chooses
  std::optional<int> views_per_direction;  // that a cell of the ground is refined from, at most
  bool classify = false;                   // the job makes likelihoods itself, in place of the scene's
  bool by_default_rule = false;            // not by kClassifierFile
};

// Of the task that takes an earlier job's survey on to more images.
struct UpdateParameters {
  IngestParameters ingest;
  std::vector<std::string> withdraw;  // flights
  bool all_epochs = false;
};

// What the update task needs to know of files that it does not read (kFilesFile). Paths as in SceneView.
struct UpdateFiles {
  struct Known {
    bool mesh = false;            // of the base
    std::string content;          // else: PixelContent of an image or of likelihoods
    std::string classified = {};  // of an image: likelihood_content, where the base made the likelihoods itself
  };
  std::map<std::string, Known> known;          // of the scene: the same bytes as a file of the base
  std::map<std::string, std::string> carried;  // of the base: under which names the job has them
};

struct CutParameters {
  TileParameters tile;
  std::vector<CellRect> cores;  // of all tiles of the job, by id, so that cut can tell whose faces it needs
  int window_px = 7;            // of the method: how far pixels depend on those around them
  int coarsest_level = 2;
  bool borders = false;  // kBordersFile is among the inputs, in place of what the survey says
};

// Of the task that makes a view's likelihoods. It does not read the survey, so that an update finds what its base made.
struct ClassifyParameters {
  int32_t view = 0;
  std::string view_json;     // ViewsToJson of the view alone, without names
  std::string classes_json;  // ClassesToJson
  std::vector<double> up;    // local frame
  double gsd_m = 0;
  double depth_m = 0;  // what lies farther from the camera is not looked at
  bool by_default_rule = false;
};

// Of the task that sums up what classify counted.
struct BordersParameters {
  int classes = 0;
  std::vector<int32_t> views;  // ascending
};

// Of the task that gives a tile's core as the job found it.
struct StartParameters {
  TileParameters tile;
};

// Which tiles' states and sums the tasks of a tile read: ids, ascending, its own too. Cut finds them on the mesh from
// what each operator is proven to read, and writes them as kReadsFile.
struct TileReads {
  std::vector<int> label;  // solve of a label step: sums and states
  std::vector<int> mend;   // states
  std::vector<int> sight;  // measure: states
  std::vector<int> solve;  // solve of an iteration: sums and states
  friend bool operator==(const TileReads&, const TileReads&) = default;
};

// Of the task that does all steps of the job's only tile.
struct RefineParameters {
  int rounds = 0;  // 0: the default
  std::string method;
  MethodSettings settings = {};
};

// Of measure, solve and mend.
struct StepParameters {
  int rounds = 0;  // as RefineParameters
  std::string method;
  MethodSettings settings = {};
  int step = 0;         // index in RefineStepsOf
  bool before = false;  // mend: of the start, before this step; else after it
  TileParameters tile = {};
  std::vector<int> states = {};  // tiles whose kStateFile are among the inputs, ascending; none at the first
  std::vector<int> sums = {};    // solve: tiles whose kSumsFile are among the inputs, ascending
  std::vector<int> held = {};    // of `states`: tiles that an update leaves as they are; their vertices are fixed
  bool goes_on = false;          // the first step of an update: what the states report is of the base
  // Mend, where an update goes on with another mesh: faces from this id on are in no state, but at their start. -1: all
  // are in states.
  int64_t first_new_face = -1;
};

// What new images show of a block of ground, against the surface of an update's base.
struct CompareParameters {
  CellRect cells;              // of change cells (change_cells.h): whole blocks
  std::vector<int32_t> views;  // that may see it, ascending; their files are inputs
  std::vector<int> states;     // tiles of the base whose kStateFile are among the inputs, ascending
};
std::string ChangeBlockFile(const CellRect& cells);  // what it writes

// All of them together, and the surface after the update.
struct ChangesParameters {
  std::vector<CellRect> blocks;
  std::vector<int> states;  // tiles whose last kStateFile are among the inputs, ascending
  std::string scene_name;
  bool outdated = false;  // the base's kOutdatedFile is among the inputs
};

struct PublishParameters {
  std::vector<TileParameters> tiles;  // by id; with an empty core: gone, without a state
  std::vector<int> kept = {};         // tiles that an update took over from its base, ascending
  std::string scene_name = {};        // for the report, with the warnings about the scene
  std::vector<std::string> warnings = {};
  bool outdated = false;            // kOutdatedFile is among the inputs
  std::vector<int> set_aside = {};  // tiles whose refinement failed, and which are as they were before, ascending
  bool flip_edges = false;          // edges are flipped where that makes creases straight
};

std::string ToJson(const IngestParameters& parameters);
std::string ToJson(const UpdateParameters& parameters);
std::string ToJson(const UpdateFiles& files);
std::string ToJson(const CutParameters& parameters);
std::string ToJson(const ClassifyParameters& parameters);
std::string ToJson(const BordersParameters& parameters);
std::string ToJson(const StartParameters& parameters);
std::string ToJson(const RefineParameters& parameters);
std::string ToJson(const StepParameters& parameters);
std::string ToJson(const CompareParameters& parameters);
std::string ToJson(const ChangesParameters& parameters);
std::string ToJson(const PublishParameters& parameters);

// INVALID_ARGUMENT if `json` lacks a parameter or has one of a wrong type.
StatusOr<IngestParameters> ParseIngestParameters(const std::string& json);
StatusOr<UpdateParameters> ParseUpdateParameters(const std::string& json);
StatusOr<UpdateFiles> ParseUpdateFiles(const std::string& json);
StatusOr<CutParameters> ParseCutParameters(const std::string& json);
StatusOr<ClassifyParameters> ParseClassifyParameters(const std::string& json);
StatusOr<BordersParameters> ParseBordersParameters(const std::string& json);
StatusOr<StartParameters> ParseStartParameters(const std::string& json);
StatusOr<RefineParameters> ParseRefineParameters(const std::string& json);
StatusOr<StepParameters> ParseStepParameters(const std::string& json);
StatusOr<CompareParameters> ParseCompareParameters(const std::string& json);
StatusOr<ChangesParameters> ParseChangesParameters(const std::string& json);
StatusOr<PublishParameters> ParsePublishParameters(const std::string& json);

std::string ToJson(const TileReads& reads);
// Of tile `tile` of `tiles`. INVALID_ARGUMENT unless `json` is just what ToJson writes, with ids of the job's tiles,
// ascending, the tile itself among each.
StatusOr<TileReads> ParseTileReads(const std::string& json, int tile, int tiles);

}  // namespace tessera

#endif  // TESSERA_COMMON_JOB_TASK_PARAMETERS_H_
