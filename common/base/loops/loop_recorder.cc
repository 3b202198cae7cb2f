#include "common/base/loops/loop_recorder.h"

#include <cxxabi.h>

#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <memory>
#include <set>
#include <utility>

namespace tessera {
namespace {

// Processor time, so that other processes of the machine hardly matter.
double ThreadSeconds() {
  timespec time = {};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

std::string Demangled(const char* name) {
  int status = 0;
  const std::unique_ptr<char, decltype(&std::free)> out(abi::__cxa_demangle(name, nullptr, nullptr, &status),
                                                        &std::free);
  return status == 0 ? out.get() : name;
}

void Erase(const std::string& part, std::string* text) {
  for (size_t at; (at = text->find(part)) != std::string::npos;) text->erase(at, part.size());
}

}  // namespace

double WorkRecord::TotalSeconds() const {
  double sum = seconds;
  for (const LoopRecord& loop : loops) sum += loop.TotalSeconds();
  return sum;
}

double LoopRecord::TotalSeconds() const {
  double sum = 0;
  for (const WorkRecord& chunk : chunks) sum += chunk.TotalSeconds();
  return sum;
}

std::string LoopRecord::Name() const {
  std::string name = Demangled(body->name());
  Erase("tessera::", &name);
  Erase("(anonymous namespace)::", &name);
  // ParallelForEach<Index, Body>(...)::{lambda...}: Body is the caller's.
  const std::string each = "ParallelForEach<";
  if (name.rfind(each, 0) == 0) name = name.substr(name.find(", ") + 2);
  const std::string lambda_begins = "::{lambda";
  const size_t lambda = name.find(lambda_begins), number = name.find('#', lambda);
  if (lambda == std::string::npos || number == std::string::npos) return name;
  const size_t parameters = lambda + lambda_begins.size();
  const std::string which = name.substr(parameters, name.find('}', number) - parameters);
  name.resize(std::min(lambda, name.find('(')));
  return name + " " + which;
}

thread_local LoopRecorder* LoopRecorder::of_this_thread_ = nullptr;

LoopRecorder::LoopRecorder() : last_s_(ThreadSeconds()) { of_this_thread_ = this; }

LoopRecorder::~LoopRecorder() { of_this_thread_ = nullptr; }

double LoopRecorder::AddTime() {
  const double now_s = ThreadSeconds(), passed_s = now_s - last_s_;
  last_s_ = now_s;
  current_->seconds += passed_s;
  seconds_before_ += passed_s;
  return passed_s;
}

void LoopRecorder::Run(int64_t chunks, const std::function<void(int64_t)>& run, const std::type_info& body) {
  AddTime();
  LoopRecord loop = {&body, std::exchange(seconds_before_, 0), std::vector<WorkRecord>(static_cast<size_t>(chunks))};
  WorkRecord* const outer = current_;
  for (int64_t chunk = 0; chunk < chunks; ++chunk) {
    current_ = &loop.chunks[static_cast<size_t>(chunk)];
    run(chunk);
    AddTime();
    seconds_before_ = 0;
  }
  current_ = outer;
  outer->loops.push_back(std::move(loop));
}

WorkRecord LoopRecorder::Take() {
  AddTime();
  seconds_before_ = 0;
  return std::exchange(all_, WorkRecord());
}

double PredictedSeconds(const WorkRecord& work, int cores, double loop_s) {
  double sum = work.seconds;
  for (const LoopRecord& loop : work.loops) sum += PredictedSeconds(loop, cores, loop_s);
  return sum;
}

double PredictedSeconds(const LoopRecord& loop, int cores, double loop_s) {
  const auto chunks = static_cast<int64_t>(loop.chunks.size());
  const auto threads = static_cast<int>(std::min<int64_t>(cores, chunks));
  if (threads <= 0) return 0;
  const int cores_each = cores / threads;
  struct Part {
    int64_t next, end;
  };
  std::vector<Part> parts;
  std::set<std::pair<double, int>> free_at;  // with the thread
  for (int thread = 0; thread < threads; ++thread) {
    parts.push_back({thread * chunks / threads, (thread + 1) * chunks / threads});
    free_at.insert({0, thread});
  }
  double end = 0;
  for (int64_t left = chunks; left > 0; --left) {
    const auto [now, thread] = *free_at.begin();
    free_at.erase(free_at.begin());
    int part = thread;
    while (parts[part].next == parts[part].end) part = (part + 1) % threads;
    const double done = now + PredictedSeconds(loop.chunks[parts[part].next++], cores_each, loop_s);
    free_at.insert({done, thread});
    end = std::max(end, done);
  }
  return threads > 1 ? end + loop_s : end;
}

}  // namespace tessera
