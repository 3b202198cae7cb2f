// How many threads a task may use: the cores of a machine follow the work at hand.
#ifndef TESSERA_SERVER_LEASES_THREAD_RULE_H_
#define TESSERA_SERVER_LEASES_THREAD_RULE_H_

namespace tessera {

// A machine as the workers on it tell of it, when one of them is given a task.
struct HostLoad {
  int cores = 0;    // 0: not known
  int workers = 0;  // on it
  int running = 0;  // tasks that they run, the new one among them
};

// The host's cores shared out among the tasks that its workers will run from now on: those that run and, as far as it
// has workers for them, the `ready` ones that wait. At least one, at most `most`, the worker's own limit. A task that
// is alone gets the whole machine; of many each worker's gets its share. What runs keeps what it was given.
int ThreadsOfTask(const HostLoad& host, int ready, int most);

}  // namespace tessera

#endif  // TESSERA_SERVER_LEASES_THREAD_RULE_H_
