// The table of task kinds. Planner, dispatcher, metrics and worker read it; a new kind is one row here and one function
// in worker/tasks.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace tessera {

// Names of kinds. They are part of task keys, records, metrics and job.json: never change one.
inline constexpr char kInspectKind[] = "inspect";
inline constexpr char kIngestKind[] = "ingest";
inline constexpr char kUpdateKind[] = "update";
inline constexpr char kBaseKind[] = "base";
inline constexpr char kPlanKind[] = "plan";
inline constexpr char kClassifyKind[] = "classify";
inline constexpr char kBordersKind[] = "borders";
inline constexpr char kCutKind[] = "cut";
inline constexpr char kCropKind[] = "crop";
inline constexpr char kStartKind[] = "start";
inline constexpr char kMeasureKind[] = "measure";
inline constexpr char kSolveKind[] = "solve";
inline constexpr char kMendKind[] = "mend";
inline constexpr char kRefineKind[] = "refine";
inline constexpr char kSplitKind[] = "split";
inline constexpr char kCompareKind[] = "compare";
inline constexpr char kChangesKind[] = "changes";
inline constexpr char kPublishKind[] = "publish";
inline constexpr char kExportKind[] = "export";

// The tasks of a job are planned in phases. Each phase is planned from the outputs of the phase before. After a task of
// kSplitKind the phases kCut and kRest follow once more.
enum class TaskPhase : uint8_t {
  kSurvey,  // its last task makes kSurveyFile
  kCut,     // makes kReadsFile: which tiles read each other
  kRest,
};

struct TaskKind {
  std::string_view name;
  std::string_view doing = {};  // for people: what the job does while such tasks run
  TaskPhase phase = TaskPhase::kRest;
  bool runs = true;              // false: the planner gives the outputs; no worker runs it
  bool can_quarantine = false;   // if it fails for good, its tile is quarantined and the job continues
  bool makes_artifacts = false;  // its outputs are the job's results
};

inline constexpr std::array<TaskKind, 19> kTaskKinds = {{
    // Some images, with their masks and likelihoods: hashes, border counts, faults.
    {kInspectKind, "inspecting the images", TaskPhase::kSurvey},
    // Scene: repaired and split mesh, survey.
    {kIngestKind, "reading the scene", TaskPhase::kSurvey},
    // Survey of the base job and a new scene: the survey with the new views.
    {kUpdateKind, "reading the new flight", TaskPhase::kSurvey},
    // Outputs of the base job.
    {.name = kBaseKind, .runs = false},
    // What an update will do (kUpdateFile).
    {.name = kPlanKind, .runs = false, .makes_artifacts = true},
    // A view: photograph and classifier: likelihoods.
    {kClassifyKind, "classifying the images"},
    // Likelihoods of all views: how reliable their class borders are.
    {kBordersKind, "measuring class borders"},
    // City and survey: the tile's package.
    {.name = kCutKind, .doing = "cutting the tiles", .phase = TaskPhase::kCut, .can_quarantine = true},
    // Package and photographs: the pixels that show the tile.
    {.name = kCropKind, .doing = "cropping the images", .can_quarantine = true},
    // City and survey: the core of a tile as it is at the start, or after the coarse levels.
    {kStartKind, "writing the start of tiles"},
    // Gradients and label evidence of one step.
    {.name = kMeasureKind, .doing = "measuring", .can_quarantine = true},
    // State of the core after one step.
    {.name = kSolveKind, .doing = "solving", .can_quarantine = true},
    // State of the core after the repair of folds.
    {.name = kMendKind, .doing = "repairing", .can_quarantine = true},
    // All steps of a job's only tile.
    {kRefineKind, "refining"},
    // City, survey and the states after the coarse levels: the city of the finest level, and its survey.
    {kSplitKind, "splitting faces"},
    // New photographs and the base's surface: change evidence of a block of ground.
    {kCompareKind, "comparing with the earlier surface"},
    // Evidence of all blocks: changes.json, changes.geojson, changes.png.
    {.name = kChangesKind, .doing = "reporting changes", .makes_artifacts = true},
    // Final states of all tiles: mesh.ply, report.json.
    {.name = kPublishKind, .doing = "publishing", .makes_artifacts = true},
    // One stage of an export (common/exporting/export_parameters.h); outputs in kExportFolder are the job's results.
    {.name = kExportKind, .doing = "exporting", .makes_artifacts = true},
}};

// Counters have one more entry than kTaskKinds, for kinds of other releases.
inline constexpr size_t kTaskKindSlots = kTaskKinds.size() + 1;

// Index of the kind in kTaskKinds; kTaskKinds.size() if it is not there.
constexpr int KindIndex(std::string_view name) {
  const auto found =
      std::find_if(kTaskKinds.begin(), kTaskKinds.end(), [&](const TaskKind& kind) { return kind.name == name; });
  return static_cast<int>(found - kTaskKinds.begin());
}

// Name of a counter's entry; "other" of the last.
constexpr std::string_view KindName(size_t index) {
  return index < kTaskKinds.size() ? kTaskKinds[index].name : "other";
}

// The row of a kind; of a kind that is not in the table one of TaskPhase::kRest.
constexpr TaskKind KindOf(std::string_view name) {
  const int index = KindIndex(name);
  return index < static_cast<int>(kTaskKinds.size()) ? kTaskKinds[index] : TaskKind{name};
}

}  // namespace tessera
