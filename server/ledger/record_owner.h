// The job that a stored record belongs to.
#pragma once

#include <string_view>

#include "server/store/record_store.h"

namespace tessera {

namespace v1 {
class Record;
}  // namespace v1

// Index of the record's job; -1: none.
int JobOf(const v1::Record& record);

// The same of a serialized record; no job if it cannot be parsed. Matches OwnerOf.
RecordOwner OwnerOfRecord(std::string_view content);

}  // namespace tessera
