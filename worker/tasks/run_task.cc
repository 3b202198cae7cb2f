#include <algorithm>
#include <iterator>
#include <new>
#include <string_view>

#include "common/job/task_kinds.h"
#include "worker/tasks/task.h"
#include "worker/tasks/task_functions.h"

namespace tessera {
namespace {

struct TaskFunction {
  std::string_view kind;
  StatusOr<TaskOutcome> (*run)(const TaskRequest&, const TaskControl&, const Clock&);
};

constexpr TaskFunction kFunctions[] = {
    {kIngestKind, RunIngest},     {kUpdateKind, RunUpdate},   {kCutKind, RunCut},         {kCropKind, RunCrop},
    {kRefineKind, RunRefine},     {kMeasureKind, RunMeasure}, {kSolveKind, RunSolve},     {kMendKind, RunRepair},
    {kCompareKind, RunCompare},   {kChangesKind, RunChanges}, {kPublishKind, RunPublish}, {kStartKind, RunStart},
    {kClassifyKind, RunClassify}, {kBordersKind, RunBorders}};

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

}  // namespace

StatusOr<TaskOutcome> RunTask(const TaskRequest& request, const TaskControl& control) {
  const TaskFunction* const function = FindFunction(request.kind);
  if (function == std::end(kFunctions)) return UnknownKind(request.kind);
  const SystemClock clock;
  try {
    return function->run(request, control, clock);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(request.kind + ": out of memory");
  }
}

}  // namespace tessera
