#include "common/base/task_usage.h"

#include <malloc.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <string>

#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr int kLargestHeapBlock_bytes = 32 << 20;  // the largest value that mallopt accepts on 64-bit systems
constexpr int kHeapGrowth_bytes = 4 << 20;         // the heap grows by at least this

double CoreSeconds() {
  rusage usage = {};
  if (getrusage(RUSAGE_SELF, &usage) != 0) return 0;
  const auto seconds = [](const timeval& t) { return static_cast<double>(t.tv_sec) + 1e-6 * t.tv_usec; };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

// The value of the line `name` of /proc/self/status; 0 if there is no such line.
int64_t StatusBytes(const std::string& name) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.starts_with(name + ":")) return std::atoll(line.c_str() + name.size() + 1) * 1024;
  }
  return 0;
}

int64_t PeakBytes() { return StatusBytes("VmHWM"); }

// Resident memory beyond that at the first call of this function in the process.
int64_t HeldBytes() {
  const int64_t now = StatusBytes("VmRSS");
  static const int64_t first = now;
  return std::max<int64_t>(0, now - first);
}

bool ResetPeak() {
  std::ofstream file("/proc/self/clear_refs");
  file << "5" << std::flush;
  return file.good();
}

}  // namespace

void KeepFreedMemory(int64_t bytes) {
  const int heaps = 1 + ThreadCount() / 8;
  mallopt(M_ARENA_MAX, heaps);
  mallopt(M_MMAP_THRESHOLD, kLargestHeapBlock_bytes);
  mallopt(M_TRIM_THRESHOLD, static_cast<int>(std::min<int64_t>(bytes / heaps, std::numeric_limits<int>::max())));
  mallopt(M_TOP_PAD, kHeapGrowth_bytes);
}

TaskUsageMeter::TaskUsageMeter(bool with_peak) : with_peak_(with_peak) {
  if (with_peak_) {
    malloc_trim(0);
    peak_was_reset_ = ResetPeak();
    start_peak_bytes_ = PeakBytes();
    held_bytes_ = HeldBytes();
  }
  start_core_seconds_ = CoreSeconds();
}

TaskUsage TaskUsageMeter::Read() const {
  TaskUsage usage;
  usage.core_seconds = CoreSeconds() - start_core_seconds_;
  usage.threads = ThreadCount();
  if (!with_peak_) return usage;
  const int64_t peak_bytes = PeakBytes();
  if (peak_was_reset_ || peak_bytes > start_peak_bytes_) usage.peak_bytes = peak_bytes - held_bytes_;
  return usage;
}

bool PeakSampling::IsDue(const std::string& kind, Clock::time_point now) {
  const auto [entry, is_first] = measured_.try_emplace(kind, now);
  if (!is_first && now - entry->second < kPause) return false;
  entry->second = now;
  return true;
}

}  // namespace tessera
