// A coordinator: accepts jobs, leases their tasks to workers, and plans what follows from their results.
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
  // Restores the state that the store's records describe. Tasks that are leased keep their lease for a full term, so
  // that their workers can continue. A record that cannot be used is quarantined; its job fails, unless it has ended,
  // and so does a job that later needs the content of an unreadable record.
  static StatusOr<std::unique_ptr<Coordinator>> Open(const DispatchEnvironment& environment,
                                                     const DispatchOptions& options);
  // Only quarantines unusable records, as Open does.
  static Status QuarantineUnusable(const DispatchEnvironment& environment);
  // Ends all waits first.
  ~Coordinator() { core_.Stop(); }

  DispatchCore& core() { return core_; }
  Jobs& jobs() { return jobs_; }
  Leases& leases() { return leases_; }
  PlanningLoop& planning() { return planning_; }
  Recovery& recovery() { return recovery_; }

  // Ends expired leases and attempts that stall, and takes steps of jobs that could not be taken before. To be called
  // about once a second.
  Status Tick();

 private:
  Coordinator(const DispatchEnvironment& environment, const DispatchOptions& options);

  DispatchCore core_;
  Recovery recovery_{core_};
  PlanningLoop planning_{core_, recovery_};
  Leases leases_;
  Jobs jobs_{core_, planning_, recovery_};
};

}  // namespace tessera
