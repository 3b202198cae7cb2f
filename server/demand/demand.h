// How many workers of which memory have enough work: what a scheduler such as Slurm should be asked for.
#pragma once

#include <cstdint>
#include <vector>

#include "server/ledger/ledger.h"

namespace tessera {

// A size of worker that a scheduler can start.
struct WorkerClass {
  int64_t memory_bytes = 0;
  int cores = 1;
  double time_limit_s = 0;  // longest lifetime; 0: no limit
};

inline constexpr double kWorth_s = 300;  // default work for a worker

struct ClassDemand {
  int workers = 0;    // for the tasks of this class and of all larger ones together
  double core_s = 0;  // predicted, of the class's own tasks that have not succeeded
};

struct Demand {
  std::vector<ClassDemand> classes;  // as given
  std::vector<TaskRef> unfit;        // tasks that no class can run, at most kUnfitTold
  int64_t unfit_count = 0;
};
inline constexpr int kUnfitTold = 20;

// One core each, with the bounds of kMemoryClasses_GiB; the last has no bound.
std::vector<WorkerClass> DefaultClasses();

// `classes`: of ascending memory. A task belongs to the smallest class that has its memory and time; without a
// prediction of its memory, to the smallest. A job wants as many workers as the widest of its phases (tasks of equal
// depth) that are still to come has unfinished tasks. All jobs want at most so many that each worker has `worth_s` of
// work, and at least one if there is work. Until a job is planned to its end, its finished tasks count as well, so that
// the number rises while the job is planned and then only falls. Paused and held jobs want none.
//
// Takes no longer for more tasks, unless one fits no class.
Demand DemandOf(const Ledger& ledger, const std::vector<WorkerClass>& classes, double worth_s);

}  // namespace tessera
