// Preconditions of records: what must hold before a change is stored and applied.
#pragma once

#include <vector>

#include "common/base/status.h"
#include "common/storage/hash.h"

namespace tessera {

class Ledger;
struct JobTask;
namespace v1 {
class Record;
}  // namespace v1

// Whether the ledger may apply the record in its present state. NOT_FOUND: its job or task does not exist;
// FAILED_PRECONDITION: the state does not allow it; INVALID_ARGUMENT: the record is malformed.
Status CheckRecord(const Ledger& ledger, const v1::Record& record);
// FAILED_PRECONDITION with both digests if the task recomputed a lost result and the outputs differ.
Status CheckSameAsBefore(const JobTask& task, const std::vector<NamedDigest>& outputs);
// FAILED_PRECONDITION with what to do first if the job may not be deleted. Precondition: the job exists.
Status CheckMayDelete(const Ledger& ledger, int job);

}  // namespace tessera
