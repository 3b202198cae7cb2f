#include <new>
#include <utility>

#include "worker/tasks/stages.h"
#include "worker/tasks/task.h"

namespace tessera {

StatusOr<TaskOutcome> RunTask(const TaskRequest& request, const TaskControl& control) {
  using Stage = StatusOr<TaskOutcome> (*)(const TaskRequest&, const TaskControl&, const Clock&);
  static constexpr std::pair<const char*, Stage> kStages[] = {
      {"ingest", RunIngest},     {"update", RunUpdate},   {"cut", RunCut},         {"crop", RunCrop},
      {"refine", RunRefine},     {"measure", RunMeasure}, {"solve", RunSolve},     {"mend", RunRepair},
      {"compare", RunCompare},   {"changes", RunChanges}, {"publish", RunPublish}, {"start", RunStart},
      {"classify", RunClassify}, {"borders", RunBorders}};
  const SystemClock clock;
  for (const auto& [kind, stage] : kStages) {
    if (request.kind != kind) continue;
    try {
      return stage(request, control, clock);
    } catch (const std::bad_alloc&) {
      return absl::ResourceExhaustedError(request.kind + ": out of memory");
    }
  }
  return absl::InvalidArgumentError("task kind: found \"" + request.kind +
                                    "\", expected ingest, update, classify, borders, cut, crop, refine, measure, "
                                    "solve, mend, compare, changes, publish or start");
}

}  // namespace tessera
