// Memory and cores that a process may use. Containers, batch systems and affinity masks allow less than the machine
// has.
#pragma once

#include <cstdint>
#include <string>

namespace tessera {

// The smallest memory limit of this process's control group and its ancestors (version 2: memory.max, version 1:
// memory.limit_in_bytes); the largest int64_t if there is none. `root` replaces "/" in the paths that are read; for
// tests.
int64_t GroupMemoryLimit_bytes(const std::string& root = "");

// The same for processor time, in cores (cpu.max; cpu.cfs_quota_us / cpu.cfs_period_us); 0: no limit.
double GroupCoreLimit(const std::string& root = "");

// The memory that this process may use: the smallest of the machine's memory, the limits of its control groups, its
// resource limits (RLIMIT_AS, RLIMIT_DATA) and the value passed to SetMemoryLimit.
int64_t MemoryLimit_bytes();

// Bound on each kind of buffer that a task has only to give this number of threads work: a 32nd of MemoryLimit_bytes at
// the first call, at most 256 MiB or, if that is more, 32 MiB a thread. Predictions of a task's memory are for two
// threads; with this bound, more threads take little of a worker's memory.
int64_t LookaheadLimit_bytes(int threads);

// Sets the user's limit; 0: none. Not thread-safe: call it before starting threads.
void SetMemoryLimit(int64_t bytes);

// The cores that this process may use at the same time: the smallest of the machine's cores, those of its affinity mask
// and its control groups' limit (rounded down); at least 1.
int CoreLimit();

}  // namespace tessera
