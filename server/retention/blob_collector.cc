#include "server/retention/blob_collector.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace tessera {
namespace {

// Age at which files of unfinished writes are deleted.
constexpr double kLeftover_s = 86400;

}  // namespace

using Kind = BlobEntry::Kind;

// A blob is written before any record refers to it, so a blob without reference may be a new one. So both its file and
// the time for which passes found it unreferenced must exceed the grace period.
StatusOr<Collected> BlobCollector::Pass(const std::function<bool()>& stop) {
  struct Spare {
    int64_t since_us = 0;
    BlobEntry file;
  };
  Collected collected;
  std::vector<Spare> spare;
  std::vector<BlobEntry> quarantined;
  absl::flat_hash_map<std::string, int64_t> unneeded;
  const BlobReferences references = reclaimer_->CollectReferences();
  const auto remove = [&](const std::vector<BlobEntry>& files) -> Status {
    TESSERA_ASSIGN_OR_RETURN(const std::vector<BlobEntry> gone, reclaimer_->RemoveBlobs(files));
    for (const BlobEntry& file : gone) {
      ++collected.files;
      collected.bytes += file.size_bytes;
      collected.bytes_left -= file.size_bytes;
      unneeded.erase(file.name);
    }
    return absl::OkStatus();
  };
  for (int part = 0; part < BlobStore::kParts; ++part) {
    if (stop && stop()) return collected;
    const int64_t now_us = clock_->MonotonicUs(), unix_us = clock_->UnixTimeUs();
    std::vector<BlobEntry> doomed;
    TESSERA_ASSIGN_OR_RETURN(std::vector<BlobEntry> listed, blobs_->List(part));
    for (BlobEntry& file : listed) {
      collected.bytes_left += file.size_bytes;
      if (file.kind == Kind::kQuarantined) {
        quarantined.push_back(std::move(file));
        continue;
      }
      const int64_t wait_us = Micros(file.kind == Kind::kLeftover ? kLeftover_s : options_.grace_s);
      const bool is_old = unix_us - file.since_us >= wait_us;
      if (file.kind == Kind::kBlob) {
        const uint64_t id = BlobReferences::IdOf(file.sha256);
        if (references.Needs(id) || options_.keep.contains(file.sha256)) continue;
        if (const int64_t since_us = references.SpareSince(id); since_us >= 0) {
          if (is_old) spare.push_back({since_us, std::move(file)});
          continue;
        }
      }
      const auto known = unneeded_since_us_.find(file.name);
      const int64_t since_us = known == unneeded_since_us_.end() ? now_us : known->second;
      unneeded[file.name] = since_us;
      if (now_us - since_us >= wait_us && is_old) doomed.push_back(std::move(file));
    }
    TESSERA_RETURN_IF_ERROR(remove(doomed));
  }
  std::stable_sort(quarantined.begin(), quarantined.end(),
                   [](const BlobEntry& a, const BlobEntry& b) { return a.since_us < b.since_us; });
  std::stable_sort(spare.begin(), spare.end(), [](const Spare& a, const Spare& b) { return a.since_us < b.since_us; });
  TESSERA_RETURN_IF_ERROR(remove(TakeExpired(quarantined)));
  const auto is_full = [&] { return options_.limit_bytes > 0 && collected.bytes_left > options_.limit_bytes; };
  for (size_t i = 0; is_full() && i < quarantined.size(); ++i) TESSERA_RETURN_IF_ERROR(remove({quarantined[i]}));
  for (size_t i = 0; is_full() && i < spare.size(); ++i) TESSERA_RETURN_IF_ERROR(remove({spare[i].file}));
  unneeded_since_us_ = std::move(unneeded);
  return collected;
}

std::vector<BlobEntry> BlobCollector::TakeExpired(std::vector<BlobEntry>& quarantined) {
  std::vector<KeptThing> kept;
  for (const BlobEntry& file : quarantined) kept.push_back({file.name, file.since_us});
  const std::vector<int> places = quarantine_retention_.Expired(kept, clock_->UnixTimeUs(), clock_->MonotonicUs());
  std::vector<BlobEntry> expired;
  for (auto place = places.rbegin(); place != places.rend(); ++place) {
    expired.push_back(std::move(quarantined[*place]));
    quarantined.erase(quarantined.begin() + *place);
  }
  return expired;
}

}  // namespace tessera
