// What follows from a call of a worker: it is told once the change is durable, and the dispatcher does what has become
// possible.
#include <algorithm>
#include <utility>

#include "server/jobs/dispatcher.h"

namespace tessera {

Status Dispatcher::ReportSuccess(const std::string& worker, const std::string& task, int attempt,
                                 const ReportedResult& result) {
  return Settle(TakeSuccess(worker, task, attempt, result));
}

void Dispatcher::ReportSuccess(const std::string& worker, const std::string& task, int attempt,
                               const ReportedResult& result, Done done) {
  Settle(TakeSuccess(worker, task, attempt, result), std::move(done));
}

Status Dispatcher::ReportFailure(const std::string& worker, const std::string& task, int attempt,
                                 const TaskFailure& failure) {
  return Settle(TakeFailure(worker, task, attempt, failure));
}

void Dispatcher::ReportFailure(const std::string& worker, const std::string& task, int attempt,
                               const TaskFailure& failure, Done done) {
  if (failure.error_class != ErrorClass::kLostInput) {
    return Settle(TakeFailure(worker, task, attempt, failure), std::move(done));
  }
  examine_thread_.Do([=, this, done = std::move(done)] { Settle(TakeFailure(worker, task, attempt, failure), done); });
}

Status Dispatcher::UnregisterWorker(const std::string& worker) { return Settle(TakeLeave(worker)); }

void Dispatcher::UnregisterWorker(const std::string& worker, Done done) { Settle(TakeLeave(worker), std::move(done)); }

Status Dispatcher::Settle(const Status& taken) {
  TESSERA_RETURN_IF_ERROR(taken);
  const int64_t reported = journal_.last();
  Advance().IgnoreError();  // Tick tries again and tells
  return journal_.Wait(reported);
}

void Dispatcher::Settle(const Status& taken, Done done) {
  if (!taken.ok()) return done(taken);
  journal_.WhenStored(std::move(done));
  std::unique_lock lock(mutex_);
  const bool due = AdvanceIsDueLocked();
  lock.unlock();
  if (due) AdvanceSoon();
}

bool Dispatcher::AdvanceIsDueLocked() {
  const std::vector<TaskRef>& ready = ledger_.newly_ready();
  if (!ledger_.due_jobs().empty()) return true;
  if (std::any_of(ready.begin(), ready.end(), [&](TaskRef ref) { return MayReuseLocked(ref); })) return true;
  ledger_.TakeNewlyReady();
  return false;
}

void Dispatcher::AdvanceSoon() {
  if (advance_soon_.exchange(true)) return;
  advance_thread_.Do([this] {
    advance_soon_ = false;
    Advance().IgnoreError();  // Tick tries again and tells
  });
}

}  // namespace tessera
