#include "server/web/lanes.h"

#include <gtest/gtest.h>

#include <future>
#include <string>

namespace tessera {
namespace {

LaneLimits NoThreads() { return {0, 0}; }

// Work that runs until it is released.
class Held {
 public:
  std::function<void()> Work() {
    return [this] {
      begun_.set_value();
      end_.get_future().wait();
    };
  }
  bool Begins(int wait_ms) {
    return is_begun_.wait_for(std::chrono::milliseconds(wait_ms)) == std::future_status::ready;
  }
  void Release() { end_.set_value(); }

 private:
  std::promise<void> begun_, end_;
  std::future<void> is_begun_ = begun_.get_future();
};

constexpr int kLong_ms = 60'000, kShort_ms = 50;

TEST(LanesTest, AnOwnerWithItsShareWaitsAndLetsOthersPass) {
  Held of_anna[4], of_ben;
  {
    Lanes lanes({NoThreads(), NoThreads(), LaneLimits{3, 10, 2}, NoThreads()});
    for (Held& held : of_anna) ASSERT_TRUE(lanes.Run(Lane::kFile, "anna", held.Work()));
    EXPECT_TRUE(of_anna[0].Begins(kLong_ms));
    EXPECT_TRUE(of_anna[1].Begins(kLong_ms));
    EXPECT_FALSE(of_anna[2].Begins(kShort_ms));
    ASSERT_TRUE(lanes.Run(Lane::kFile, "ben", of_ben.Work()));
    EXPECT_TRUE(of_ben.Begins(kLong_ms)) << "although two requests were there before";
    of_anna[0].Release();
    EXPECT_TRUE(of_anna[2].Begins(kLong_ms));
    EXPECT_FALSE(of_anna[3].Begins(kShort_ms));
    of_ben.Release();
    EXPECT_FALSE(of_anna[3].Begins(kShort_ms));
    for (Held* const held : {&of_anna[1], &of_anna[2], &of_anna[3]}) held->Release();
  }
  EXPECT_TRUE(of_anna[3].Begins(0)) << "what waits runs when the lanes end";
}

TEST(LanesTest, AnOwnerFillsNoMoreThanHalfOfTheQueue) {
  Held running, other;
  int ran = 0;
  std::mutex mutex;
  const auto count = [&] {
    std::lock_guard lock(mutex);
    ++ran;
  };
  {
    Lanes lanes({NoThreads(), NoThreads(), LaneLimits{2, 10, 1}, NoThreads()});
    ASSERT_TRUE(lanes.Run(Lane::kFile, "anna", running.Work()));
    ASSERT_TRUE(running.Begins(kLong_ms));
    for (int i = 0; i < 5; ++i) EXPECT_TRUE(lanes.Run(Lane::kFile, "anna", count));
    EXPECT_FALSE(lanes.Run(Lane::kFile, "anna", count));
    EXPECT_TRUE(lanes.Run(Lane::kFile, "ben", other.Work()));
    EXPECT_TRUE(other.Begins(kLong_ms));
    running.Release();
    other.Release();
  }
  EXPECT_EQ(ran, 5);
}

}  // namespace
}  // namespace tessera
