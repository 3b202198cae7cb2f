#include "server/dispatch/waiting_workers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>
#include <vector>

namespace tessera {
namespace {

using testing::ElementsAre;

class WaitingWorkersTest : public testing::Test {
 protected:
  // Returns once the worker waits.
  void StartWaiting(const std::string& worker) {
    std::unique_lock lock(mutex_);
    threads_.emplace_back([this, worker] {
      std::unique_lock own(mutex_);
      ++waiting_count_;
      waits_.notify_all();
      waiting_.Wait(own, worker, std::chrono::steady_clock::now() + std::chrono::hours(1));
      woken_.push_back(worker);
      waits_.notify_all();
    });
    waits_.wait(lock, [&, before = waiting_count_] { return waiting_count_ > before; });
  }
  void AwaitWoken(size_t count) {
    std::unique_lock lock(mutex_);
    waits_.wait(lock, [&] { return woken_.size() >= count; });
  }
  void TearDown() override {
    {
      std::lock_guard lock(mutex_);
      waiting_.WakeAll();
    }
    for (std::thread& thread : threads_) thread.join();
  }

  std::mutex mutex_;
  std::condition_variable waits_;
  WaitingWorkers waiting_;
  int waiting_count_ = 0;
  std::vector<std::string> woken_;
  std::vector<std::thread> threads_;
};

TEST_F(WaitingWorkersTest, OneIsWokenForEachTask) {
  for (const char* worker : {"a", "b", "c"}) StartWaiting(worker);
  {
    std::lock_guard lock(mutex_);
    EXPECT_FALSE(waiting_.WakeNext()) << "there is nothing that they have not seen";
    waiting_.ReadyHasGrown();
    EXPECT_TRUE(waiting_.Wake("b"));
    EXPECT_FALSE(waiting_.Wake("b"));
    EXPECT_FALSE(waiting_.Wake("unknown"));
  }
  AwaitWoken(1);
  StartWaiting("b");  // has seen it, and left it
  {
    std::lock_guard lock(mutex_);
    EXPECT_TRUE(waiting_.WakeNext());
  }
  AwaitWoken(2);
  {
    std::lock_guard lock(mutex_);
    EXPECT_TRUE(waiting_.WakeNext());
    EXPECT_FALSE(waiting_.WakeNext()) << "all have seen it";
  }
  AwaitWoken(3);
  EXPECT_THAT(woken_, ElementsAre("b", "a", "c"));
}

}  // namespace
}  // namespace tessera
