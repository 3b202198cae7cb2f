#include "common/base/status.h"

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace tessera {

Status InputError(const std::string& file, const std::string& place, const std::string& found,
                  const std::string& expected) {
  return absl::InvalidArgumentError(
      absl::StrCat(file, place.empty() ? "" : ": ", place, ": found ", found, ", expected ", expected));
}

void Faults::Add(const Status& status) {
  if (!status.ok()) messages_.emplace_back(status.message());
}

Status Faults::ToStatus() const {
  if (messages_.empty()) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrJoin(messages_, "\n"));
}

}  // namespace tessera
