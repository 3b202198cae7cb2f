// How many threads a task may use.
#pragma once

namespace tessera {

// A machine when a worker on it is given a task.
struct HostLoad {
  int cores = 0;    // 0: not known
  int workers = 0;  // on it
  int running = 0;  // tasks that they run, the new one among them
};

// Divides the host's cores by the number of tasks that its workers run soon: the running ones and, up to the number of
// its workers, the `ready` ones. At least 1, at most `most`, the worker's own limit. Running tasks keep their threads.
int ThreadsOfTask(const HostLoad& host, int ready, int most);

}  // namespace tessera
