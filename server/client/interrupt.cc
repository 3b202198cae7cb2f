#include "server/client/interrupt.h"

#include <signal.h>

#include <atomic>
#include <chrono>
#include <thread>

namespace tessera {
namespace {

std::atomic<int> interrupts{0};
static_assert(std::atomic<int>::is_always_lock_free);  // as a signal handler needs it

void Count(int) { ++interrupts; }

}  // namespace

void InstallInterruptCounter() {
  struct sigaction action = {};
  action.sa_handler = Count;
  sigemptyset(&action.sa_mask);
  action.sa_flags = SA_RESTART;
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) ::sigaction(signal, &action, nullptr);
}

int Interrupts() { return interrupts; }

Sleeper InterruptibleSleep(int signals) {
  return [signals](double seconds) {
    std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
    return Interrupts() < signals;
  };
}

}  // namespace tessera
