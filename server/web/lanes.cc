#include "server/web/lanes.h"

#include <utility>

namespace tessera {

Lanes::Lanes(const std::array<LaneLimits, kLanes>& limits) {
  for (size_t i = 0; i < kLanes; ++i) lanes_[i].limits = limits[i];
}

Lanes::~Lanes() {
  Stop();
  for (OneLane& lane : lanes_) {
    for (std::thread& thread : lane.threads) thread.join();
  }
}

bool Lanes::Run(Lane which, std::function<void()> work) {
  std::lock_guard lock(mutex_);
  OneLane& lane = lanes_[static_cast<size_t>(which)];
  if (stopped_) return false;
  const bool has_idle = static_cast<size_t>(lane.idle) > lane.waiting.size();
  const bool may_grow = static_cast<int>(lane.threads.size()) < lane.limits.threads;
  if (!has_idle && !may_grow && lane.waiting.size() >= lane.limits.waiting) return false;
  lane.waiting.push_back(std::move(work));
  if (!has_idle && may_grow) lane.threads.emplace_back([this, &lane] { Serve(lane); });
  lane.changed.notify_one();
  return true;
}

void Lanes::Stop() {
  std::lock_guard lock(mutex_);
  stopped_ = true;
  for (OneLane& lane : lanes_) lane.changed.notify_all();
}

int Lanes::threads() const {
  std::lock_guard lock(mutex_);
  size_t count = 0;
  for (const OneLane& lane : lanes_) count += lane.threads.size();
  return static_cast<int>(count);
}

void Lanes::Serve(OneLane& lane) {
  std::unique_lock lock(mutex_);
  while (true) {
    ++lane.idle;
    lane.changed.wait(lock, [&] { return stopped_ || !lane.waiting.empty(); });
    --lane.idle;
    if (lane.waiting.empty()) return;
    const std::function<void()> work = std::move(lane.waiting.front());
    lane.waiting.pop_front();
    lock.unlock();
    work();
    lock.lock();
  }
}

}  // namespace tessera
