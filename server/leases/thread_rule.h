// Thread limit of a task.
#pragma once

namespace tessera {

// Load of a machine (WorkerInfo::machine), including the task being leased.
struct MachineLoad {
  int cores = 0;    // 0: unknown
  int workers = 0;  // registered
  int running = 0;  // leased tasks, with the new one
};

// Cores of the machine divided by the tasks that will run on it: running plus `ready`, at most one per worker. At least
// 1, at most `most`, the worker's limit. Running tasks keep their threads.
int ThreadsOfTask(const MachineLoad& machine, int ready, int most);

}  // namespace tessera
