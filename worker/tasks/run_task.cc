#include <Eigen/Geometry>
#include <algorithm>
#include <iterator>
#include <new>
#include <string_view>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "common/job/task_kinds.h"
#include "common/job/task_parameters.h"
#include "worker/tasks/task.h"
#include "worker/tasks/task_functions.h"
#include "worker/tile/tile_workspace.h"

namespace tessera {
namespace {

struct TaskFunction {
  std::string_view kind;
  StatusOr<TaskOutcome> (*run)(const TaskRequest&, const TaskControl&, const Clock&);
  bool opens_workspace = false;  // with TileWorkspace::Open
};

constexpr TaskFunction kFunctions[] = {{kInspectKind, RunInspect},
                                       {kIngestKind, RunIngest},
                                       {kUpdateKind, RunUpdate},
                                       {kCutKind, RunCut},
                                       {kCropKind, RunCrop},
                                       {kRefineKind, RunRefine},
                                       {kSplitKind, RunSplit},
                                       {kMeasureKind, RunMeasure, true},
                                       {kSolveKind, RunSolve, true},
                                       {kMendKind, RunRepair, true},
                                       {kCompareKind, RunCompare},
                                       {kChangesKind, RunChanges},
                                       {kPublishKind, RunPublish},
                                       {kStartKind, RunStart},
                                       {kClassifyKind, RunClassify},
                                       {kBordersKind, RunBorders},
                                       {kExportKind, RunExport}};

constexpr const TaskFunction* FindFunction(std::string_view kind) {
  return std::find_if(std::begin(kFunctions), std::end(kFunctions),
                      [&](const TaskFunction& function) { return function.kind == kind; });
}

static_assert(std::all_of(kTaskKinds.begin(), kTaskKinds.end(),
                          [](const TaskKind& kind) {
                            return (FindFunction(kind.name) != std::end(kFunctions)) == kind.runs;
                          }),
              "a kind of kTaskKinds has a function if and only if workers run it");
static_assert(static_cast<size_t>(std::count_if(kTaskKinds.begin(), kTaskKinds.end(),
                                                [](const TaskKind& kind) { return kind.runs; })) ==
                  std::size(kFunctions),
              "every function has one row of kTaskKinds");

Status UnknownKind(const std::string& kind) {
  std::string expected;
  for (const TaskKind& known : kTaskKinds) {
    if (known.runs) expected.append(expected.empty() ? "" : ", ").append(known.name);
  }
  return absl::InvalidArgumentError("task kind: found \"" + kind + "\", expected one of " + expected);
}

// The text with paths of the scene's files relative to the scene, and of other inputs relative to the inputs. The
// folder of the inputs exists only during the task and means nothing to the user.
std::string WithoutFolder(const TaskRequest& request, std::string_view text) {
  const std::string scene = absl::StrCat(request.input_dir, "/", kSceneFolder);
  return absl::StrReplaceAll(std::string(text),
                             {{scene + "/", ""}, {scene, "the scene"}, {request.input_dir + "/", ""}});
}

}  // namespace

StatusOr<TaskOutcome> RunTask(const TaskRequest& request, const TaskControl& control) {
  const TaskFunction* const function = FindFunction(request.kind);
  if (function == std::end(kFunctions)) return UnknownKind(request.kind);
  const SystemClock clock;
  if (!function->opens_workspace) TrimIdleWorkspaces();
  try {
    StatusOr<TaskOutcome> outcome = function->run(request, control, clock);
    if (!outcome.ok()) {
      Status named(outcome.status().code(), WithoutFolder(request, std::string(outcome.status().message())));
      outcome.status().ForEachPayload([&](auto url, const auto& payload) { named.SetPayload(url, payload); });
      return named;
    }
    for (std::string& warning : outcome->warnings) warning = WithoutFolder(request, warning);
    return outcome;
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(request.kind + ": out of memory");
  }
}

}  // namespace tessera
