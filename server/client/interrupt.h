// Ctrl-C and its like, as something to ask for instead of an end.
#ifndef TESSERA_SERVER_CLIENT_INTERRUPT_H_
#define TESSERA_SERVER_CLIENT_INTERRUPT_H_

namespace tessera {

// From here on SIGINT, SIGTERM and SIGHUP only count.
void CountInterrupts();

// How many have come. Any thread.
int Interrupts();

// Sleeps; whether none has come by then.
bool PauseUnlessInterrupted(double seconds);

}  // namespace tessera

#endif  // TESSERA_SERVER_CLIENT_INTERRUPT_H_
