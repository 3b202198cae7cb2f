// Counts interrupts (Ctrl-C) so that commands can stop in order.
#pragma once

#include "common/base/retry/retry.h"

namespace tessera {

// From this call on, SIGINT, SIGTERM and SIGHUP are counted and do not end the process.
void InstallInterruptCounter();

// Number of signals so far. May be called from any thread.
int Interrupts();

// A sleeper that is cancelled from the given number of signals on.
Sleeper InterruptibleSleep(int signals);

}  // namespace tessera
