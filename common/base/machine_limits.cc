#include "common/base/machine_limits.h"

#include <sched.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <functional>
#include <limits>
#include <sstream>
#include <thread>
#include <vector>

namespace tessera {
namespace {

constexpr int64_t kNoLimit = std::numeric_limits<int64_t>::max();

int64_t& UserLimit_bytes() {
  static int64_t limit = kNoLimit;
  return limit;
}

// The number at the start of the file; `fallback` if there is no file or no number ("max").
int64_t ReadNumber(const std::string& path, int64_t fallback) {
  std::ifstream file(path);
  int64_t number = 0;
  return file >> number ? number : fallback;
}

// Calls visit(folder) for the process's control group of `controller` ("": version 2) and for each of its ancestors.
// The mount point comes last: in a container it may be the only folder of the group that is visible.
void ForEachGroup(const std::string& root, const std::string& controller,
                  const std::function<void(const std::string& folder)>& visit) {
  std::ifstream groups(root + "/proc/self/cgroup");
  for (std::string line; std::getline(groups, line);) {  // "4:cpu,memory:/path"
    std::istringstream fields(line);
    std::string number, controllers, path;
    if (!std::getline(fields, number, ':') || !std::getline(fields, controllers, ':') || !std::getline(fields, path)) {
      continue;
    }
    if (("," + controllers + ",").find("," + controller + ",") == std::string::npos || path[0] != '/') continue;
    const std::string mount = root + "/sys/fs/cgroup";
    std::vector<std::string> mounts = {mount + "/" + controller};
    if (controller.empty()) mounts = {mount, mount + "/unified"};
    for (const std::string& at : mounts) {
      for (std::string group = path; group.size() > 1; group.resize(group.rfind('/'))) visit(at + group);
      visit(at);
    }
  }
}

}  // namespace

int64_t GroupMemoryLimit_bytes(const std::string& root) {
  int64_t least = kNoLimit;
  ForEachGroup(root, "", [&](const std::string& folder) {
    least = std::min(least, ReadNumber(folder + "/memory.max", kNoLimit));
  });
  ForEachGroup(root, "memory", [&](const std::string& folder) {
    least = std::min(least, ReadNumber(folder + "/memory.limit_in_bytes", kNoLimit));
  });
  return least;
}

double GroupCoreLimit(const std::string& root) {
  double least = 0;
  const auto limit = [&](int64_t quota, int64_t period) {
    if (quota <= 0 || period <= 0) return;  // -1, "max" or no file: no limit
    const double cores = static_cast<double>(quota) / static_cast<double>(period);
    least = least > 0 ? std::min(least, cores) : cores;
  };
  ForEachGroup(root, "", [&](const std::string& folder) {
    std::ifstream file(folder + "/cpu.max");
    int64_t quota = 0, period = 0;
    if (file >> quota >> period) limit(quota, period);
  });
  ForEachGroup(root, "cpu", [&](const std::string& folder) {
    limit(ReadNumber(folder + "/cpu.cfs_quota_us", 0), ReadNumber(folder + "/cpu.cfs_period_us", 0));
  });
  return least;
}

int64_t MemoryLimit_bytes() {
  int64_t least = static_cast<int64_t>(sysconf(_SC_PHYS_PAGES)) * sysconf(_SC_PAGESIZE);
  for (const auto resource : {RLIMIT_AS, RLIMIT_DATA}) {
    rlimit limit = {};
    if (getrlimit(resource, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY) {
      least = std::min(least, static_cast<int64_t>(limit.rlim_cur));
    }
  }
  return std::min({least, GroupMemoryLimit_bytes(), UserLimit_bytes()});
}

int64_t LookaheadLimit_bytes(int threads) {
  static const int64_t share_bytes = MemoryLimit_bytes() / 32;
  return std::min(share_bytes, std::max(int64_t{256} << 20, int64_t{threads} << 25));
}

void SetMemoryLimit(int64_t bytes) { UserLimit_bytes() = bytes > 0 ? bytes : kNoLimit; }

int CoreLimit() {
  int cores = static_cast<int>(std::thread::hardware_concurrency());
  cpu_set_t mask;
  if (sched_getaffinity(0, sizeof(mask), &mask) == 0) cores = std::min(cores, CPU_COUNT(&mask));
  const double share = GroupCoreLimit();
  if (share > 0) cores = std::min(cores, static_cast<int>(share));
  return std::max(1, cores);
}

}  // namespace tessera
