// Reuse of results: a task whose key has a known result succeeds without a worker.
#pragma once

#include "server/leases/dispatch_core.h"

namespace tessera {

// Whether the task is ready and has a known result, whose blobs may be lost. Needs the core's mutex.
bool MayReuse(Ledger& ledger, TaskRef ref);
// Takes such a task out of the ready tasks until ReuseResults has checked its result. Needs the core's mutex.
void SetAside(DispatchCore& core, TaskRef ref);
// Completes the tasks of SetAside whose blobs are stored, or cannot be checked now: if a blob is lost after all, its
// reader reports that, and the task is computed. Forgets the results of the others, which become ready again for a
// worker. Returns false if no task was set aside. Calls the blob store: call without the core's mutex, and not in a
// thread that answers callers.
bool ReuseResults(DispatchCore& core);

}  // namespace tessera
