#include "common/base/loops/loop_recorder.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <ctime>
#include <thread>
#include <utility>
#include <vector>

#include "common/base/parallel.h"

namespace tessera {
namespace {

// Uses so much processor time of the calling thread.
void Work(double seconds) {
  const auto now = [] {
    timespec time = {};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
  };
  for (const double end = now() + seconds; now() < end;) {
  }
}

WorkRecord Seconds(double seconds) { return {seconds, {}}; }

LoopRecord LoopOf(std::vector<WorkRecord> chunks) { return {&typeid(int), 0, std::move(chunks)}; }

TEST(LoopRecorderTest, RecordsChunksAndWhatIsOutsideLoops) {
  const ThreadLimit limit(3);
  LoopRecorder recorder;
  const std::thread::id here = std::this_thread::get_id();
  std::vector<int64_t> begun;
  Work(.02);
  ParallelFor(7, 3, [&](int64_t begin, int64_t) {
    EXPECT_EQ(std::this_thread::get_id(), here);
    EXPECT_EQ(ThreadCount(), 3);
    begun.push_back(begin);
    if (begin == 3) {
      Work(.01);
      ParallelForEach(2, 1, [](int64_t i) { Work(i == 0 ? .01 : .03); });
    }
  });
  Work(.005);
  ParallelSum(4, 4, [](int64_t, int64_t) { return 0.0; });
  const WorkRecord work = recorder.Take();
  EXPECT_EQ(begun, (std::vector<int64_t>{0, 3, 6}));
  EXPECT_GE(work.seconds, .025);
  EXPECT_GE(work.TotalSeconds(), .075);
  ASSERT_EQ(work.loops.size(), 2u);
  EXPECT_GE(work.loops[0].seconds_before, .02);
  EXPECT_GE(work.loops[1].seconds_before, .005);
  EXPECT_LT(work.loops[1].seconds_before, .02);
  EXPECT_EQ(work.loops[1].chunks.size(), 1u);
  ASSERT_EQ(work.loops[0].chunks.size(), 3u);
  EXPECT_LT(work.loops[0].chunks[0].TotalSeconds(), .005);
  const WorkRecord& middle = work.loops[0].chunks[1];
  EXPECT_GE(middle.seconds, .01);
  EXPECT_LT(middle.seconds, .03);
  ASSERT_EQ(middle.loops.size(), 1u);
  ASSERT_EQ(middle.loops[0].chunks.size(), 2u);
  EXPECT_GE(middle.loops[0].chunks[1].seconds, .03);
  EXPECT_EQ(recorder.Take().loops.size(), 0u);
}

TEST(LoopRecorderTest, RecordsOnlyItsOwnThread) {
  LoopRecorder recorder;
  EXPECT_EQ(LoopRecorder::OfThisThread(), &recorder);
  std::thread([] {
    EXPECT_EQ(LoopRecorder::OfThisThread(), nullptr);
    ParallelForEach(5, 1, [](int64_t) {});
  }).join();
  EXPECT_TRUE(recorder.Take().loops.empty());
}

struct Caller {
  static void CallsFor() { ParallelFor(1, 1, [](int64_t, int64_t) {}); }
  static void CallsForEach() {
    ParallelForEach(1, 1, [](int64_t) {});
    ParallelForEach(1, 1, [](int64_t) {});
  }
};

TEST(LoopRecorderTest, NamesTheFunctionOfALoop) {
  LoopRecorder recorder;
  Caller::CallsFor();
  Caller::CallsForEach();
  const WorkRecord work = recorder.Take();
  ASSERT_EQ(work.loops.size(), 3u);
  EXPECT_EQ(work.loops[0].Name(), "Caller::CallsFor (long, long)#1");
  EXPECT_EQ(work.loops[1].Name(), "Caller::CallsForEach (long)#1");
  EXPECT_EQ(work.loops[2].Name(), "Caller::CallsForEach (long)#2");
}

TEST(PredictedSecondsTest, EachCoreTakesItsPartAndThenHelpsTheNext) {
  const LoopRecord loop = LoopOf({Seconds(3), Seconds(1), Seconds(1), Seconds(2)});
  EXPECT_DOUBLE_EQ(PredictedSeconds(loop, 1, .5), 7);
  EXPECT_DOUBLE_EQ(PredictedSeconds(loop, 2, .5), 4.5);  // 3 + 1; 1 + 2
  // 2 + 6; 3 + 1 + 4. In the order of the chunks it would be 10: 2 + 3 + 1; 6 + 4.
  const LoopRecord uneven = LoopOf({Seconds(2), Seconds(6), Seconds(3), Seconds(1), Seconds(4)});
  EXPECT_DOUBLE_EQ(PredictedSeconds(uneven, 2, 0), 8);
  EXPECT_DOUBLE_EQ(PredictedSeconds(loop, 9, .5), 3.5);
  EXPECT_DOUBLE_EQ(PredictedSeconds({10, {loop, loop}}, 2, .5), 19);
  EXPECT_EQ(PredictedSeconds(LoopOf({}), 4, .5), 0);
}

TEST(PredictedSecondsTest, LoopsWithinChunksShareTheCoresLeft) {
  const LoopRecord inner = LoopOf({Seconds(1), Seconds(1), Seconds(1), Seconds(1)});
  const LoopRecord outer = LoopOf({{1, {inner}}, {1, {inner}}});
  EXPECT_DOUBLE_EQ(PredictedSeconds(outer, 2, 0), 5);
  EXPECT_DOUBLE_EQ(PredictedSeconds(outer, 4, 0), 3);
  EXPECT_DOUBLE_EQ(PredictedSeconds(outer, 8, 0), 2);
}

}  // namespace
}  // namespace tessera
