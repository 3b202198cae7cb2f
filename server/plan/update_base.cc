#include "server/plan/update_base.h"

#include "absl/strings/str_cat.h"
#include "common/job/task_kinds.h"

namespace tessera {
namespace {

constexpr char kCarriedPrefix[] = ".base/";

}  // namespace

std::string CarriedName(const NamedDigest& file) {
  // A file that the base carried keeps its name.
  return IsCarried(file.name) ? file.name
                              : absl::StrCat(kCarriedPrefix, file.digest.sha256.substr(0, 16), "/", file.name);
}

bool IsCarried(const std::string& name) { return name.starts_with(kCarriedPrefix); }

bool LiesInScene(const std::string& name) { return !IsCarried(name) && name != kClassifierFile; }

CostScale CostsOf(const UpdateBase& base, const Survey& survey) {
  MeasuredCosts measured = base.measured;
  // Ingest was planned without a survey: predict it from the survey now.
  const auto ingest = measured.find(kIngestKind);
  if (ingest != measured.end()) ingest->second.predicted = PredictIngest(survey).core_seconds;
  return CostScale(measured);
}

}  // namespace tessera
