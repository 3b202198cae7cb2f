// Calls of workers that wait for their answer and for what follows from them, for tests of one thread.
#pragma once

#include <functional>
#include <future>
#include <memory>
#include <string>
#include <utility>

#include "server/jobs/coordinator.h"

namespace tessera {

inline LeaseAnswer LeaseAndWait(Coordinator& coordinator, const std::string& worker, double wait_s,
                                const std::function<bool()>& gone, int64_t call = 0) {
  const auto answer = std::make_shared<std::promise<LeaseAnswer>>();
  coordinator.leases().LeaseTask(
      {worker, wait_s, call, gone, [answer](LeaseAnswer given) { answer->set_value(std::move(given)); }});
  return answer->get_future().get();
}

// Plans what follows from the call, and waits until what the call changed is durable.
inline Status FinishAndWait(Coordinator& coordinator, const Status& handled) {
  TESSERA_RETURN_IF_ERROR(handled);
  const Journal& journal = coordinator.core().journal();
  const int64_t reported = journal.last();
  coordinator.planning().Advance().IgnoreError();  // Tick tries again and returns the error
  return journal.Wait(reported);
}

inline Status ReportSuccessAndWait(Coordinator& coordinator, const std::string& worker, const std::string& task,
                                   int attempt, const ReportedResult& result) {
  return FinishAndWait(coordinator, coordinator.leases().HandleSuccess(worker, task, attempt, result));
}

inline Status ReportFailureAndWait(Coordinator& coordinator, const std::string& worker, const std::string& task,
                                   int attempt, const TaskFailure& failure) {
  return FinishAndWait(coordinator, coordinator.leases().HandleFailure(worker, task, attempt, failure));
}

inline Status UnregisterAndWait(Coordinator& coordinator, const std::string& worker) {
  return FinishAndWait(coordinator, coordinator.leases().HandleUnregister(worker));
}

}  // namespace tessera
