#include "server/client/commands.h"

namespace tessera {

void AddSynthCommand(CLI::App&, int*) {}

}  // namespace tessera
