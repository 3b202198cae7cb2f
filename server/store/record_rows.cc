#include "server/store/record_rows.h"

#include <utility>

namespace tessera {

RecordRows::RecordRows(std::set<int64_t> quarantined, std::map<int64_t, int64_t> removed, std::set<int> deleted_jobs,
                       const std::function<void(const StoredRecord& record)>& visit)
    : quarantined_(std::move(quarantined)),
      removed_(std::move(removed)),
      deleted_jobs_(std::move(deleted_jobs)),
      visit_(visit),
      next_removed_(removed_.begin()) {}

void RecordRows::Add(int64_t id, const std::string& content, int64_t xxh3, int job) {
  for (; next_removed_ != removed_.end() && next_removed_->first == expected_; ++next_removed_) {
    expected_ = next_removed_->second + 1;
  }
  if (id != expected_ && !quarantined_.contains(expected_)) {
    visit_({expected_, absl::DataLossError("record missing, as are all before " + std::to_string(id))});
  }
  expected_ = id + 1;
  if (quarantined_.contains(id) || deleted_jobs_.contains(job)) return;
  const auto hash = static_cast<int64_t>(Xxh3(content));
  if (hash == xxh3) {
    visit_({id, content});
  } else {
    visit_({id, absl::DataLossError("row " + std::to_string(id) + " of table records is damaged: its " +
                                    std::to_string(content.size()) + " bytes hash to " + std::to_string(hash) +
                                    ", expected " + std::to_string(xxh3))});
  }
}

}  // namespace tessera
