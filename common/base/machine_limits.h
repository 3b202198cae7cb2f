// What of its machine a process may really use: containers, batch systems and affinity masks give it less than there is.
#ifndef TESSERA_COMMON_BASE_MACHINE_LIMITS_H_
#define TESSERA_COMMON_BASE_MACHINE_LIMITS_H_

#include <cstdint>
#include <string>

namespace tessera {

// The least limit of memory that a control group of this process, or one above it, has (version 2: memory.max,
// version 1: memory.limit_in_bytes); int64_t's largest where there is none. `root` stands for "/" in the paths that are
// read, for tests.
int64_t GroupMemoryLimit_bytes(const std::string& root = "");

// The same of processor time, in cores (cpu.max; cpu.cfs_quota_us / cpu.cfs_period_us); 0: no limit.
double GroupCoreLimit(const std::string& root = "");

// The memory that this process may come to use: the machine's, its control groups', its own limit (RLIMIT_AS,
// RLIMIT_DATA) or what SetMemoryLimit said, whichever is least.
int64_t MemoryLimit_bytes();

// A limit that the user set; 0: none. To be called before threads are started.
void SetMemoryLimit(int64_t bytes);

// The cores that this process may use at a time: the machine's, those of its affinity mask, or its control groups' share
// (rounded down), whichever is least; at least 1.
int CoreLimit();

}  // namespace tessera

#endif  // TESSERA_COMMON_BASE_MACHINE_LIMITS_H_
