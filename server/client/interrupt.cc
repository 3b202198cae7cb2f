#include "server/client/interrupt.h"

#include <signal.h>

#include <atomic>

namespace tessera {
namespace {

std::atomic<int> interrupts{0};
static_assert(std::atomic<int>::is_always_lock_free);  // as a signal handler needs it

void Count(int) { ++interrupts; }

}  // namespace

void CountInterrupts() {
  struct sigaction action = {};
  action.sa_handler = Count;
  sigemptyset(&action.sa_mask);
  action.sa_flags = SA_RESTART;
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) ::sigaction(signal, &action, nullptr);
}

int Interrupts() { return interrupts; }

}  // namespace tessera
