// Parameters of the tasks. The planner writes them as canonical JSON, which is part of the task's key.
#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "common/job/ground.h"
#include "common/job/method_settings.h"
#include "common/job/refine_steps.h"

namespace tessera {

// Names of the files that tasks write and read. The comment names the task that writes the file.
inline constexpr char kInspectionFile[] = "inspection.json";   // inspect: what some images hold (common/check)
inline constexpr char kCityFile[] = "city.arrays";             // ingest, split: the repaired and split mesh
inline constexpr char kSurveyFile[] = "survey.json";           // ingest, split
inline constexpr char kPlainSurveyFile[] = "plain.json";       // ingest, split: the survey without names, for tasks
inline constexpr char kBaseSurveyFile[] = "base-survey.json";  // the survey of an update's base job
inline constexpr char kFilesFile[] = "files.json";             // locations of files that an update does not read
inline constexpr char kUpdateFile[] = "update.json";           // plan of an update: tiles to compute, reasons and cost
inline constexpr char kTileFile[] = "tile.arrays";             // cut
inline constexpr char kViewsFile[] = "views.arrays";           // crop: the pixels of the views that show the tile
inline constexpr char kReadsFile[] = "reads.json";             // cut: the tiles that the tasks of this tile read
inline constexpr char kSumsFile[] = "sums.arrays";             // measure: sums of the data term over the core's faces
inline constexpr char kStateFile[] = "state.arrays";           // solve, mend, refine: positions and labels of the core
inline constexpr char kMovedFile[] = "moved.arrays";           // split: the surface after the coarse levels
inline constexpr char kMeshFile[] = "mesh.ply";                // publish
inline constexpr char kReportFile[] = "report.json";           // publish
inline constexpr char kTileMeshFolder[] = "tiles";             // publish, with several tiles: one mesh per tile
inline constexpr char kTileIndexFile[] = "tiles/index.json";
inline constexpr char kExportFolder[] = "export/";  // export: results, in a folder a format
inline constexpr char kSceneFolder[] = "scene";     // folder of scene files among the inputs
// The trained classifier (common/classify/model.h). It is listed among the files of the job's scene.
inline constexpr char kClassifierFile[] = ".classifier";
inline constexpr char kBordersFile[] = "borders.json";  // borders: reliability of class borders in the likelihoods
// changes: faces of an update's result that no longer exist in the scene
inline constexpr char kOutdatedFile[] = "outdated.arrays";
inline constexpr char kChangesGeoJsonFile[] = "changes.geojson";  // changes

// Name of a view's file among the inputs of crop, independent of its name in the scene. Likelihood files have this
// suffix.
inline constexpr char kLikelihoodsEnding[] = ".likelihoods";
std::string ViewFileName(int32_t view, bool likelihoods);
// The same for the mask of its photograph.
std::string ViewMaskName(int32_t view);
// The file with the border counts of a view's likelihoods, written by classify.
std::string ViewBordersName(int32_t view);

struct TileParameters {
  int tile = 0;
  CellRect core;
};

// Name of a tile's file among the inputs of a task that reads several tiles: "0003/state.arrays".
std::string TileInputName(int tile, const std::string& file);

// Whether a worker fetches the input `name` of a task when the task asks for it (TaskRequest::fetch): a pixel file of
// the scene if the task reads inspections, a file of a view (ViewFileName, ViewMaskName) if it reads earlier crops.
class FetchedOnDemand {
 public:
  // Call with the names of all inputs of the task.
  void AddInput(const std::string& name);
  bool operator()(const std::string& name) const;

 private:
  bool reads_inspections_ = false, reads_crops_ = false;
};

// Parameters of inspect, which inspects the pixel files among its inputs.
struct InspectParameters {
  bool classify = false;  // as in IngestParameters
};

// Parameters of ingest. Only settings that differ from the default are set, so that methods that split faces equally
// often share one ingest task.
struct IngestParameters {
  // Unset: the defaults.
  std::optional<int> partners;             // partner views per view
  std::optional<int> views_per_direction;  // maximum number of views per ground cell and direction
  bool classify = false;                   // the job computes likelihoods and ignores those of the scene
  bool by_default_rule = false;            // with the default rule instead of kClassifierFile
  double skip_images = 0;                  // as in SceneLoadOptions
  bool anyway = false;
  bool coarse_faces = false;  // split to the size of the coarse levels: kSplitKind splits again
  // Number of inspections of the scene's pixel files among the inputs: TileInputName(i, kInspectionFile) from i = 0.
  // 0: the task inspects the files itself.
  int inspections = 0;
};

// Parameters of update, which extends the survey of the base job by new images.
struct UpdateParameters {
  IngestParameters ingest;
  std::vector<std::string> withdraw;  // names of flights that are no longer used
  bool all_epochs = false;
};

// Information for the update task about files that it does not read (kFilesFile). Paths as in SceneView.
struct UpdateFiles {
  struct Known {
    bool mesh = false;            // the mesh of the base job
    std::string content;          // PixelContent of an image or of likelihoods; empty for the mesh
    std::string classified = {};  // for an image: likelihood_content, if the base job computed the likelihoods
  };
  std::map<std::string, Known> known;          // by path: files of the scene that equal a file of the base job
  std::map<std::string, std::string> carried;  // files of the base job: path there to path in this job
};

struct CutParameters {
  TileParameters tile;
  std::vector<CellRect> cores;  // of all tiles of the job, by id; determines the owner of each face
  int window_px = 7;            // side of the method's comparison windows
  int coarsest_level = 2;
  bool borders = false;  // kBordersFile is among the inputs and replaces the survey's borders
  // In the fine part of a job (JobPart), else empty: the iterations of each of its rounds, all on the coarsest level.
  // kMovedFile is then among the inputs.
  std::vector<int> fine_iterations = {};
  std::optional<double> max_step_px = {};  // MethodSettings::max_step_px; set only with fine_iterations
};

// Parameters of crop, which crops the images for some tiles. Their packages (TileInputName) are among the inputs.
struct CropParameters {
  std::vector<int> tiles;  // ascending
  // In the fine part of a job (JobPart), in which only windows are cropped that the crops of the coarse part lack. Per
  // tile: kViewsFile of this tile (TileInputName) has its coarse crops. Empty: there are none.
  std::vector<int> coarse = {};
};

// Parameters of classify, which computes a view's likelihoods. It does not read the survey, so that an update can reuse
// the result of its base job.
struct ClassifyParameters {
  int32_t view = 0;
  std::string view_json;     // ViewsToJson of this view, without names
  std::string classes_json;  // ClassesToJson
  std::vector<double> up;    // local frame
  double gsd_m = 0;
  double depth_m = 0;  // faces farther from the camera are ignored
  bool by_default_rule = false;
};

// Parameters of borders, which sums the border counts of classify.
struct BordersParameters {
  int classes = 0;
  std::vector<int32_t> views;  // ascending
};

// Parameters of start, which writes the start state of a tile's core.
struct StartParameters {
  TileParameters tile;
  bool moved = false;  // kMovedFile is among the inputs: the state after the coarse levels
};

// Parameters of split, which splits the faces of the surface that the coarse levels moved. The states of the tiles with
// ids below `tiles` are among the inputs.
struct SplitParameters {
  int tiles = 0;
};

// The tiles whose states and sums the tasks of a tile read: ascending ids, including its own. Cut computes them from
// the dependency radius of each operator and writes them to kReadsFile.
struct TileReads {
  std::vector<int> label;       // solve, label step: sums and states
  std::vector<int> repair;      // repair: states
  std::vector<int> visibility;  // measure: states, for visibility
  std::vector<int> solve;       // solve, geometry step: sums and states
  friend bool operator==(const TileReads&, const TileReads&) = default;
};

// Parameters of refine, which runs all steps of a job with one tile, or those of a part.
struct RefineParameters {
  int rounds = 0;  // 0: the method's default
  std::string method;
  MethodSettings settings = {};
  JobPart part = JobPart::kWhole;  // kFine: kStateFile, with which it starts, is among the inputs
};

// Parameters of measure, solve and repair.
struct StepParameters {
  int rounds = 0;  // as RefineParameters
  std::string method;
  MethodSettings settings = {};
  int step = 0;         // index in RefineStepsOf
  bool before = false;  // repair: of the start state, before this step; else after the step
  TileParameters tile = {};
  std::vector<int> states = {};  // tiles whose kStateFile are among the inputs, ascending; empty in the first step
  std::vector<int> sums = {};    // solve: tiles whose kSumsFile are among the inputs, ascending
  std::vector<int> frozen = {};  // of `states`: tiles that an update does not compute; their vertices are frozen
  bool continues_base = false;   // the first step of an update: the statistics in the states are of the base job
  // Repair, in an update with another mesh: faces with ids from this one on are in no state; they have their start
  // positions. -1: all faces are in states.
  int64_t first_new_face = -1;
};

// Parameters of compare, which compares the new images of a block of ground with the surface of the base job.
struct CompareParameters {
  CellRect cells;              // whole blocks of change cells (change_cells.h)
  std::vector<int32_t> views;  // views that may see the block, ascending; their files are inputs
  std::vector<int> states;     // tiles of the base job whose kStateFile are among the inputs, ascending
};
std::string ChangeBlockFile(const CellRect& cells);  // the output file of compare

// Parameters of changes, which combines all blocks with the surface after the update.
struct ChangesParameters {
  std::vector<CellRect> blocks;
  std::vector<int> states;  // tiles whose final kStateFile are among the inputs, ascending
  std::string scene_name;
  bool outdated = false;  // kOutdatedFile of the base job is among the inputs
};

struct PublishParameters {
  std::vector<TileParameters> tiles;         // by id; an empty core: the tile was removed and has no state
  std::vector<int> kept = {};                // tiles that an update reuses from its base job, ascending
  std::string scene_name = {};               // for the report, like the next two
  std::vector<std::string> view_names = {};  // of the survey's views; empty if they are too long
  std::vector<std::string> warnings = {};
  std::string fit = {};                                                  // Survey::fit, for the report
  std::string source = {};                                               // Survey::source, for the report
  std::vector<std::pair<std::string, std::string>> skipped_images = {};  // name and reason; for the report
  bool outdated = false;                                                 // kOutdatedFile is among the inputs
  std::vector<int> quarantined = {};  // tiles whose refinement failed, ascending; they have their previous state
  bool flip_edges = false;            // flip edges where that makes creases straight
};

std::string ToJson(const InspectParameters& parameters);
std::string ToJson(const IngestParameters& parameters);
std::string ToJson(const UpdateParameters& parameters);
std::string ToJson(const UpdateFiles& files);
std::string ToJson(const CutParameters& parameters);
std::string ToJson(const CropParameters& parameters);
std::string ToJson(const ClassifyParameters& parameters);
std::string ToJson(const BordersParameters& parameters);
std::string ToJson(const StartParameters& parameters);
std::string ToJson(const SplitParameters& parameters);
std::string ToJson(const RefineParameters& parameters);
std::string ToJson(const StepParameters& parameters);
std::string ToJson(const CompareParameters& parameters);
std::string ToJson(const ChangesParameters& parameters);
std::string ToJson(const PublishParameters& parameters);

// INVALID_ARGUMENT if `json` lacks a parameter or has one of a wrong type.
StatusOr<InspectParameters> ParseInspectParameters(const std::string& json);
StatusOr<IngestParameters> ParseIngestParameters(const std::string& json);
StatusOr<UpdateParameters> ParseUpdateParameters(const std::string& json);
StatusOr<UpdateFiles> ParseUpdateFiles(const std::string& json);
StatusOr<CutParameters> ParseCutParameters(const std::string& json);
StatusOr<CropParameters> ParseCropParameters(const std::string& json);
StatusOr<ClassifyParameters> ParseClassifyParameters(const std::string& json);
StatusOr<BordersParameters> ParseBordersParameters(const std::string& json);
StatusOr<StartParameters> ParseStartParameters(const std::string& json);
StatusOr<SplitParameters> ParseSplitParameters(const std::string& json);
StatusOr<RefineParameters> ParseRefineParameters(const std::string& json);
StatusOr<StepParameters> ParseStepParameters(const std::string& json);
StatusOr<CompareParameters> ParseCompareParameters(const std::string& json);
StatusOr<ChangesParameters> ParseChangesParameters(const std::string& json);
StatusOr<PublishParameters> ParsePublishParameters(const std::string& json);

std::string ToJson(const TileReads& reads);
// Parses the TileReads of tile `tile` of `tiles`. INVALID_ARGUMENT unless `json` is the canonical form with valid ids
// in ascending order, and each list contains the tile itself.
StatusOr<TileReads> ParseTileReads(const std::string& json, int tile, int tiles);

}  // namespace tessera
