#include "server/plan/stages.h"

#include <gtest/gtest.h>

#include <vector>

#include "common/job/task_kinds.h"

namespace tessera {
namespace {

TEST(FailedBefore, OrdersTasksOfATileAsTheyRun) {
  std::vector<FailedTile> failures;
  for (const bool fine : {false, true}) {
    failures.push_back({3, kCutKind, -1, false, fine});
    failures.push_back({3, kCropKind, -1, false, fine});
    for (const int step : {0, 1, 2}) {
      failures.push_back({3, kMendKind, step, true, fine});
      failures.push_back({3, kMeasureKind, step, false, fine});
      failures.push_back({3, kSolveKind, step, false, fine});
      failures.push_back({3, kMendKind, step, false, fine});
    }
  }
  const std::vector<int> good = {StageOf(kMendKind, 0, true), StageOf(kMendKind, 1)};
  for (size_t i = 0; i < failures.size(); ++i) {
    for (size_t k = 0; k < failures.size(); ++k) {
      EXPECT_EQ(FailedBefore(failures[i], failures[k]), i < k) << i << ", " << k;
      if (failures[i].fine != failures[k].fine || i > k) continue;
      EXPECT_LE(FrozenFrom(failures[i], good), FrozenFrom(failures[k], good)) << i << ", " << k;
    }
  }
}

}  // namespace
}  // namespace tessera
