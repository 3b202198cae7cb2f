// Opens tiles' states among a task's inputs.
#pragma once

#include <vector>

#include "common/base/status.h"
#include "worker/tasks/task.h"
#include "worker/tile/tile_files.h"

namespace tessera {

// The states of these tiles; their kStateFile are among the request's inputs. Errors as MappedState::Open.
StatusOr<std::vector<MappedState>> OpenStates(const TaskRequest& request, const std::vector<int>& tiles);

}  // namespace tessera
