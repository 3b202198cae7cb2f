// Tasks whose result is known under their key: they succeed without a worker.
#pragma once

#include "common/base/status.h"
#include "server/leases/dispatch_core.h"

namespace tessera {

// Whether the task is ready and its result is known. The result may not be stored any more. Needs the core's mutex.
bool MayReuse(const Ledger& ledger, TaskRef ref);
// Succeeds such a task, or forgets the result if it is not stored any more. Not under the core's mutex.
Status Reuse(DispatchCore& core, TaskRef ref);

}  // namespace tessera
