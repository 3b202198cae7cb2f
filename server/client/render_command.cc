#include "server/client/commands.h"

namespace tessera {

void AddRenderCommand(CLI::App&, int*) {}

}  // namespace tessera
