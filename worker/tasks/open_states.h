// Opens tiles' states among a task's inputs.
#ifndef TESSERA_WORKER_TASKS_OPEN_STATES_H_
#define TESSERA_WORKER_TASKS_OPEN_STATES_H_

#include <vector>

#include "common/base/status.h"
#include "worker/tasks/task.h"
#include "worker/tile/tile_files.h"

namespace tessera {

// The states of these tiles; their kStateFile are among the request's inputs. Errors as MappedState::Open.
StatusOr<std::vector<MappedState>> OpenStates(const TaskRequest& request, const std::vector<int>& tiles);

}  // namespace tessera

#endif  // TESSERA_WORKER_TASKS_OPEN_STATES_H_
