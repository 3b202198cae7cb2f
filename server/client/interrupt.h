// Counts interrupts (Ctrl-C) so that commands can stop in order.
#pragma once

namespace tessera {

// From this call on, SIGINT, SIGTERM and SIGHUP are counted and do not end the process.
void InstallInterruptCounter();

// Number of signals so far. May be called from any thread.
int Interrupts();

// Sleeps; returns whether no signal has come.
bool SleepUnlessInterrupted(double seconds);

}  // namespace tessera
