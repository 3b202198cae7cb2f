#include "worker/photo/view_schedule.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

namespace tessera {
namespace {

// Views in a row, each paired with those up to `reach` away.
std::vector<ViewPair> Neighbours(int views, int reach) {
  std::vector<ViewPair> pairs;
  for (int i = 0; i < views; ++i) {
    for (int j = std::max(0, i - reach); j <= std::min(views - 1, i + reach); ++j) {
      if (j != i) pairs.push_back({i, j});
    }
  }
  return pairs;
}

std::vector<size_t> Range(size_t begin, size_t end) {
  std::vector<size_t> out(end - begin);
  std::iota(out.begin(), out.end(), begin);
  return out;
}

constexpr double kAhead_bytes = 256 << 20;

double Nothing(size_t) { return 0; }

std::function<int(size_t)> Strips(int each) {
  return [each](size_t) { return each; };
}

// Runs all steps. Checks that the views of all references that are evaluated are open, and open only once.
void CheckAll(const std::vector<ViewPair>& pairs, size_t views, int threads, int strips_each, double view_bytes) {
  ViewSchedule schedule(pairs, views, kAhead_bytes);
  const ReferenceWork work = {threads, Strips(strips_each), 1};
  std::vector<int> opened(views, 0), closed(views, 0);
  std::vector<size_t> references;
  std::vector<size_t> first_use = Range(0, views);
  for (const ViewPair& pair : pairs) {
    size_t& first = first_use[static_cast<size_t>(pair.other)];
    first = std::min(first, static_cast<size_t>(pair.reference));
  }
  const auto bytes = [&](size_t) { return view_bytes; };
  for (size_t step = 0; step < views;) {
    for (const size_t view : schedule.Open(step, work, bytes)) ++opened[view];
    const size_t end = schedule.EndOfBatch(step, work);
    ASSERT_GT(end, step);
    for (size_t reference = step; reference < end; ++reference) {
      references.push_back(reference);
      EXPECT_TRUE(opened[reference] == 1 && closed[reference] == 0) << reference;
      for (const ViewPair& pair : schedule.pairs(reference)) {
        EXPECT_EQ(pair.reference, static_cast<int>(reference));
        EXPECT_TRUE(opened[pair.other] == 1 && closed[pair.other] == 0) << reference << " needs " << pair.other;
      }
    }
    if (end < views) {  // while these references are evaluated
      for (const size_t view : schedule.OpenAhead(end, work, bytes)) ++opened[view];
    }
    double ahead = 0;
    for (size_t view = 0; view < views; ++view) ahead += opened[view] == 1 && first_use[view] >= end ? view_bytes : 0;
    EXPECT_LE(ahead, kAhead_bytes) << step;
    for (; step < end; ++step) {
      for (const size_t view : schedule.Close(step)) ++closed[view];
    }
  }
  EXPECT_EQ(references, Range(0, views));
  EXPECT_EQ(opened, std::vector<int>(views, 1));
  EXPECT_EQ(closed, opened);
}

TEST(ViewScheduleTest, TheViewsOfReferencesAreOpen) {
  std::vector<ViewPair> some = Neighbours(20, 4);
  std::erase_if(some, [](const ViewPair& pair) { return (pair.reference * 7 + pair.other * 3) % 4 == 0; });
  for (const auto& pairs : {Neighbours(20, 3), some, std::vector<ViewPair>{{2, 19}, {5, 0}}, std::vector<ViewPair>()}) {
    for (const int threads : {1, 2, 5, 64}) {
      for (const int strips : {0, 1, 3, 50}) {
        CheckAll(pairs, 20, threads, strips, 1);
        CheckAll(pairs, 20, threads, strips, kAhead_bytes / 2.5);
        CheckAll(pairs, 20, threads, strips, 2 * kAhead_bytes);
      }
    }
  }
}

TEST(ViewScheduleTest, OpensTheViewsOfReferencesThatAreEvaluatedTogether) {
  const std::vector<ViewPair> pairs = Neighbours(30, 2);
  const ReferenceWork work = {2, Strips(3), 1};  // 8 strips
  ViewSchedule schedule(pairs, 30, kAhead_bytes);
  EXPECT_EQ(schedule.Open(0, work, Nothing), Range(0, 5));
  EXPECT_EQ(schedule.EndOfBatch(0, work), 3u);
  EXPECT_EQ(schedule.OpenAhead(3, work, Nothing), Range(5, 8));
  EXPECT_EQ(schedule.Open(3, work, Nothing), Range(0, 0));
  EXPECT_EQ(schedule.Open(5, {2, Strips(8), 1}, Nothing), Range(0, 0));
  EXPECT_EQ(schedule.EndOfBatch(3, work), 6u);
}

TEST(ViewScheduleTest, ViewsThatAreNotNeededYetFitTheBound) {
  const std::vector<ViewPair> pairs = Neighbours(30, 2);
  const ReferenceWork many = {64, Strips(1), 1};
  const auto a_third = [](size_t) { return kAhead_bytes / 3; };
  ViewSchedule schedule(pairs, 30, kAhead_bytes);
  EXPECT_EQ(schedule.Open(0, many, a_third), Range(0, 6));  // the first three are needed
  EXPECT_EQ(schedule.EndOfBatch(0, many), 4u);
  EXPECT_EQ(schedule.Open(4, many, a_third), Range(6, 10));
  ViewSchedule large(pairs, 30, kAhead_bytes);
  EXPECT_EQ(large.Open(0, many, [](size_t) { return 2 * kAhead_bytes; }), Range(0, 3));
}

TEST(ViewScheduleTest, AFewStripsAndUpToTwoReferencesForEachThreadAreEvaluatedTogether) {
  const std::vector<ViewPair> pairs = Neighbours(30, 2);
  ViewSchedule schedule(pairs, 30, kAhead_bytes);
  schedule.Open(0, {100, Strips(1), 1}, Nothing);
  EXPECT_EQ(schedule.EndOfBatch(0, {1, Strips(3), 1}), 2u);   // 4 strips
  EXPECT_EQ(schedule.EndOfBatch(5, {4, Strips(3), 1}), 11u);  // 16 strips
  EXPECT_EQ(schedule.EndOfBatch(5, {2, Strips(99), 1}), 6u);
  EXPECT_EQ(schedule.EndOfBatch(5, {4, Strips(99), 1}), 10u);
  EXPECT_EQ(schedule.EndOfBatch(5, {12, Strips(99), 1}), 26u);
  EXPECT_EQ(schedule.EndOfBatch(20, {100, Strips(3), 1}), 30u);
  // The first reference does not count.
  EXPECT_EQ(schedule.EndOfBatch(5, {100, Strips(3), kAhead_bytes / 3}), 9u);
  EXPECT_EQ(schedule.EndOfBatch(5, {100, Strips(3), 2 * kAhead_bytes}), 6u);
}

}  // namespace
}  // namespace tessera
