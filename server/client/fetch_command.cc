#include "server/client/commands.h"

namespace tessera {

void AddFetchCommand(CLI::App&, int*) {}

}  // namespace tessera
