#include "server/web/lanes.h"

#include <algorithm>
#include <utility>

namespace tessera {
namespace {

void RemoveOne(std::map<std::string, int>& counts, const std::string& owner) {
  if (const auto count = counts.find(owner); --count->second == 0) counts.erase(count);
}

}  // namespace

Lanes::Lanes(const std::array<LaneLimits, kLanes>& limits) {
  for (size_t i = 0; i < kLanes; ++i) lanes_[i].limits = limits[i];
}

Lanes::~Lanes() {
  Stop();
  for (OneLane& lane : lanes_) {
    for (std::thread& thread : lane.threads) thread.join();
  }
}

bool Lanes::Run(Lane which, const std::string& owner, std::function<void()> work) {
  std::lock_guard lock(mutex_);
  OneLane& lane = lanes_[static_cast<size_t>(which)];
  if (stopped_) return false;
  const bool has_idle = static_cast<size_t>(lane.idle) > lane.waiting.size();
  const bool may_grow = static_cast<int>(lane.threads.size()) < lane.limits.threads;
  if (!has_idle && !may_grow && lane.waiting.size() >= lane.limits.waiting) return false;
  if (lane.limits.of_owner > 0) {
    const auto waiting = lane.waiting_of.find(owner);
    if (waiting != lane.waiting_of.end() && static_cast<size_t>(waiting->second) >= lane.limits.waiting / 2)
      return false;
  }
  ++lane.waiting_of[owner];
  lane.waiting.push_back({owner, std::move(work)});
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

std::list<Lanes::Request>::iterator Lanes::NextLocked(OneLane& lane) {
  if (lane.limits.of_owner == 0 || stopped_) return lane.waiting.begin();
  return std::find_if(lane.waiting.begin(), lane.waiting.end(), [&](const Request& request) {
    const auto running = lane.running_of.find(request.owner);
    return running == lane.running_of.end() || running->second < lane.limits.of_owner;
  });
}

void Lanes::Serve(OneLane& lane) {
  std::unique_lock lock(mutex_);
  while (true) {
    ++lane.idle;
    auto next = lane.waiting.end();
    lane.changed.wait(lock, [&] { return (next = NextLocked(lane)) != lane.waiting.end() || stopped_; });
    --lane.idle;
    if (next == lane.waiting.end()) return;
    const Request request = std::move(*next);
    lane.waiting.erase(next);
    RemoveOne(lane.waiting_of, request.owner);
    ++lane.running_of[request.owner];
    lock.unlock();
    request.work();
    lock.lock();
    RemoveOne(lane.running_of, request.owner);
  }
}

}  // namespace tessera
