#include "server/dispatch/record_owner.h"

#include "tessera/v1/records.pb.h"

namespace tessera {

RecordOwner OwnerOfRecord(std::string_view content) {
  v1::Record record;
  if (!record.ParseFromArray(content.data(), static_cast<int>(content.size()))) return {};
  const int job = JobOf(record);
  return {job, job >= 0 && record.change_case() == v1::Record::kJobDeleted};
}

}  // namespace tessera
