#include "server/ledger/ready_tasks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <map>
#include <tuple>
#include <vector>

#include "common/base/random.h"

namespace tessera {
namespace {

bool Any(TaskRef) { return true; }

JobTask Task(int depth, double cost, int tile, int64_t retry_delay_us = 0) {
  JobTask task;
  task.depth = depth;
  task.plan.cost = cost;
  task.plan.tile = tile;
  task.retry_delay_us = retry_delay_us;
  return task;
}

TEST(ReadyTasks, CountsByKindAndMemoryAndFindsTheOldest) {
  ReadyTasks ready;
  const auto task = [](const char* kind, int64_t peak_bytes, int64_t delay_us = 0) {
    JobTask made = Task(1, 1, 0, delay_us);
    made.plan.kind = kind;
    made.plan.peak_bytes = peak_bytes;
    return made;
  };
  const JobTask cut = task("cut", 3LL << 30), late = task("cut", 4LL << 30), solve = task("solve", 5LL << 30);
  const JobTask delayed = task("of tomorrow", 0, 5);
  EXPECT_EQ(ready.OldestSince(), std::nullopt);
  ready.NoteTime(100);
  ready.Add({0, 0}, cut);
  ready.Add({1, 0}, solve);
  ready.NoteTime(200);
  ready.Add({0, 1}, late);
  ready.Add({0, 2}, delayed);
  const TaskGroup cuts = {KindIndex("cut"), 2}, solves = {KindIndex("solve"), 3};
  using Groups = std::map<TaskGroup, int64_t>;
  EXPECT_EQ(ready.Groups(), (Groups{{cuts, 2}, {solves, 1}}));
  EXPECT_EQ(ready.OldestSince(), 100);
  EXPECT_EQ(ready.delayed_count(), 1);
  ready.Remove({0, 0}, cut);
  EXPECT_EQ(ready.Groups(), (Groups{{cuts, 1}, {solves, 1}}));
  ready.SetJob(1, 0, /*paused=*/true);
  EXPECT_EQ(ready.Groups(), (Groups{{cuts, 1}}));
  EXPECT_EQ(ready.OldestSince(), 200);
  ready.NoteTime(300);
  ready.Promote(0);
  ready.Promote(5);
  EXPECT_EQ(ready.delayed_count(), 0);
  const TaskGroup others = {static_cast<int>(kTaskKinds.size()), kUnknownMemoryClass};
  EXPECT_EQ(ready.Groups(), (Groups{{cuts, 1}, {others, 1}}));
  ready.Remove({0, 1}, late);
  EXPECT_EQ(ready.OldestSince(), 300) << "the end of its delay";
  ready.SetJob(1, 0, /*paused=*/false);
  EXPECT_EQ(ready.OldestSince(), 100);
  ready.DropJob(1);
  ready.DropJob(0);
  EXPECT_EQ(ready.Groups(), Groups());
}

TEST(ReadyTasks, OrderIsJobAgeThenDepthThenCostThenIndex) {
  ReadyTasks ready;
  const std::vector<std::pair<TaskRef, JobTask>> in_order = {{{0, 7}, Task(1, 2, 0)},
                                                             {{0, 1}, Task(1, 1, 1)},
                                                             {{0, 3}, Task(1, 1, 2)},
                                                             {{0, 0}, Task(2, 9, 0)},
                                                             {{2, 5}, Task(0, 9, 1)}};
  for (auto it = in_order.rbegin(); it != in_order.rend(); ++it) ready.Add(it->first, it->second);
  EXPECT_EQ(ready.count(), 5);
  EXPECT_EQ(ready.FirstOfTile(0, 0, Any), (TaskRef{0, 7}));
  EXPECT_EQ(ready.FirstOfTile(1, 0, Any), std::nullopt);
  EXPECT_EQ(ready.FirstOfTile(2, 0, Any), std::nullopt);
  EXPECT_EQ(ready.First([](TaskRef ref) { return ref.task == 3; }), (TaskRef{0, 3}));
  for (const auto& [ref, task] : in_order) {
    EXPECT_EQ(ready.First(Any), ref);
    ready.Remove(ref, task);
  }
  EXPECT_EQ(ready.First(Any), std::nullopt);
  EXPECT_EQ(ready.count(), 0);
}

TEST(ReadyTasks, DelayedTaskIsFoundAfterItsDelay) {
  ReadyTasks ready;
  ready.Add({0, 0}, Task(0, 1, 0, 100));
  ready.Add({0, 1}, Task(0, 1, 0, 50));
  EXPECT_EQ(ready.First(Any), std::nullopt);
  ready.Promote(1000);  // both delays start
  EXPECT_EQ(ready.First(Any), std::nullopt);
  ready.Promote(1049);
  EXPECT_EQ(ready.First(Any), std::nullopt);
  ready.Promote(1050);
  EXPECT_EQ(ready.First(Any), (TaskRef{0, 1}));
  ready.Remove({0, 1}, Task(0, 1, 0, 50));
  ready.Remove({0, 0}, Task(0, 1, 0, 100));  // during its delay
  ready.Promote(2000);
  EXPECT_EQ(ready.First(Any), std::nullopt);
  ready.Add({1, 0}, Task(0, 1, 0, 100));
  ready.Promote(3000);
  ready.Add({1, 2}, Task(0, 1, 0, 100));  // delay not started
  ready.Add({1, 1}, Task(0, 1, 0));
  ready.DropJob(1);
  ready.Add({2, 0}, Task(0, 1, 0, 100));
  ready.Remove({2, 0}, Task(0, 1, 0, 100));
  for (const int64_t now : {4000, 5000}) ready.Promote(now);
  EXPECT_EQ(ready.count(), 0);
}

TEST(ReadyTasks, RandomAddsAndRemovesMatchAList) {
  Random random(3);
  ReadyTasks ready;
  std::vector<std::pair<TaskRef, JobTask>> list;
  std::vector<std::pair<int, bool>> standings(3);  // priority, paused
  const auto rank = [&](const auto& entry) {
    const auto [priority, paused] = standings[entry.first.job];
    return std::tuple(paused, -priority, entry.first.job, entry.second.depth, -entry.second.plan.cost,
                      entry.first.task);
  };
  for (int step = 0; step < 3000; ++step) {
    if (list.empty() || random.Below(5) < 3) {
      const TaskRef ref = {static_cast<int>(random.Below(3)), step};
      list.emplace_back(ref, Task(static_cast<int>(random.Below(4)), static_cast<double>(random.Below(3)),
                                  static_cast<int>(random.Below(5)) - 1));
      ready.Add(ref, list.back().second);
    } else {
      const auto gone = list.begin() + random.Below(static_cast<int64_t>(list.size()));
      ready.Remove(gone->first, gone->second);
      list.erase(gone);
    }
    if (random.Below(5) == 0) {
      const int job = static_cast<int>(random.Below(3));
      standings[job] = {static_cast<int>(random.Below(3)) - 1, random.Below(3) == 0};
      ready.SetJob(job, standings[job].first, standings[job].second);
    }
    const auto is_paused = [&](const auto& entry) { return standings[entry.first.job].second; };
    const auto first =
        std::min_element(list.begin(), list.end(), [&](const auto& a, const auto& b) { return rank(a) < rank(b); });
    ASSERT_EQ(ready.count(), std::count_if(list.begin(), list.end(), std::not_fn(is_paused)));
    ASSERT_EQ(ready.First(Any), first == list.end() || is_paused(*first) ? std::nullopt : std::optional(first->first));
  }
}

}  // namespace
}  // namespace tessera
