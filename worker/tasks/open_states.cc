#include "worker/tasks/open_states.h"

#include <utility>

#include "common/job/task_parameters.h"
#include "worker/tasks/task_functions.h"

namespace tessera {

StatusOr<std::vector<MappedState>> OpenStates(const TaskRequest& request, const std::vector<int>& tiles) {
  std::vector<MappedState> states;
  for (const int tile : tiles) {
    TESSERA_ASSIGN_OR_RETURN(MappedState state, MappedState::Open(InputPath(request, TileInputName(tile, kStateFile))));
    states.push_back(std::move(state));
  }
  return states;
}

}  // namespace tessera
