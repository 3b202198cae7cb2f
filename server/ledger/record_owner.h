// The job that a stored record belongs to.
#pragma once

#include <string_view>

#include "server/store/record_store.h"

namespace tessera {

namespace v1 {
class Record;
}  // namespace v1

// Index of the job that a record is of; -1 if it names none.
int JobOf(const v1::Record& record);

// Of a record's bytes; no job if they are not a record. An OwnerOf.
RecordOwner OwnerOfRecord(std::string_view content);

}  // namespace tessera
