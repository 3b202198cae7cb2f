// What a service manager is told.
#pragma once

namespace tessera {

// Tells the service manager that started this process that it is ready: sends READY=1 to the socket that NOTIFY_SOCKET
// names (sd_notify(3)). Does nothing if the variable is not set; errors are ignored, because the manager's time limit
// finds them.
void NotifyReady();

}  // namespace tessera
