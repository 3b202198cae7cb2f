// The coordinator: accepts jobs, leases their tasks to workers, and plans the next phase from their results.
#pragma once

#include <memory>

#include "common/base/status.h"
#include "server/jobs/jobs.h"
#include "server/jobs/planner.h"
#include "server/jobs/planning_loop.h"
#include "server/jobs/recovery.h"
#include "server/leases/dispatch_core.h"
#include "server/leases/leases.h"

namespace tessera {

// Owns the shared core, the four classes over it and their threads. Thread-safe.
class Coordinator {
 public:
  // Restores the state from the stored records. Leased tasks get a full lease term, so that their workers can continue.
  // Quarantines unusable records; an active job with such a record fails, and so does a job that needs its content
  // later. Returns errors of the store.
  static StatusOr<std::unique_ptr<Coordinator>> Open(const DispatchEnvironment& environment,
                                                     const DispatchOptions& options);
  // Quarantines unusable records like Open, without serving.
  static Status QuarantineUnusable(const DispatchEnvironment& environment);
  // First ends all waits.
  ~Coordinator() { core_.Stop(); }

  DispatchCore& core() { return core_; }
  Jobs& jobs() { return jobs_; }
  Leases& leases() { return leases_; }
  PlanningLoop& planning() { return planning_; }
  Recovery& recovery() { return recovery_; }

  // Ends expired leases and stalled attempts, and retries pending steps of jobs. Call about once a second.
  Status Tick();
  // The same with the steps in another thread, so that leases end while the blob store does not answer. Returns the
  // error of the last steps that were taken like this.
  Status TickInBackground();

 private:
  Coordinator(const DispatchEnvironment& environment, const DispatchOptions& options);

  DispatchCore core_;
  Recovery recovery_{core_};
  PlanningLoop planning_{core_, recovery_};
  Leases leases_;
  Jobs jobs_{core_, planning_, recovery_};
};

}  // namespace tessera
