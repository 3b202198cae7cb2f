#include "common/base/status.h"

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "common/base/message_list.h"
#include "common/base/status_parts.h"

namespace tessera {
namespace {

constexpr char kFaults[] = "Faults";                  // payload: four strings per fault
constexpr size_t kPartsOfFault = 4, kMaxFaults = 50;  // faults beyond kMaxFaults are in the message only

}  // namespace

Status InputError(const std::string& file, const std::string& location, const std::string& found,
                  const std::string& expected) {
  Status error = absl::InvalidArgumentError(
      absl::StrCat(file, location.empty() ? "" : ": ", location, ": found ", found, ", expected ", expected));
  SetFaults(error, {{file, location, found, expected}});
  return error;
}

void SetFaults(Status& error, const std::vector<InputFault>& faults) {
  std::vector<std::string> parts;
  for (const InputFault& fault : faults) {
    if (parts.size() >= kPartsOfFault * kMaxFaults) break;
    parts.insert(parts.end(), {fault.file, fault.location, fault.found, fault.expected});
  }
  if (!parts.empty()) SetParts(error, kFaults, parts);
}

std::vector<InputFault> FaultsOf(const Status& status) {
  const std::vector<std::string> parts = PartsOf(status, kFaults);
  std::vector<InputFault> faults;
  for (size_t i = 0; i + kPartsOfFault <= parts.size(); i += kPartsOfFault) {
    faults.push_back({parts[i], parts[i + 1], parts[i + 2], parts[i + 3]});
  }
  return faults;
}

void Faults::Add(const Status& status) {
  if (status.ok()) return;
  messages_.emplace_back(status.message());
  for (const std::string& part : PartsOf(status, kFaults)) {
    if (parts_.size() < kPartsOfFault * kMaxFaults) parts_.push_back(part);
  }
}

Status Faults::ToStatus() const {
  if (messages_.empty()) return absl::OkStatus();
  Status error = absl::InvalidArgumentError(ShortenLines(absl::StrJoin(messages_, "\n")));
  if (!parts_.empty()) SetParts(error, kFaults, parts_);
  return error;
}

}  // namespace tessera
