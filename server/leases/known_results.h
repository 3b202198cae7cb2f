// Reuse of results: a task whose key has a known result succeeds without a worker.
#pragma once

#include "common/base/status.h"
#include "server/leases/dispatch_core.h"

namespace tessera {

// Whether the task is ready and has a known result, whose blobs may be lost. Needs the core's mutex.
bool MayReuse(Ledger& ledger, TaskRef ref);
// Completes such a task, or forgets the result if its blobs are lost. Call without the core's mutex.
Status Reuse(DispatchCore& core, TaskRef ref);

}  // namespace tessera
