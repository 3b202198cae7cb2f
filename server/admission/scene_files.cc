#include "server/admission/scene_files.h"

#include "common/base/parallel.h"

namespace tessera {
namespace {

// Two changes within one tick of the file system's clock have the same time: only older times are trusted.
constexpr int64_t kSettledNs = 2'000'000'000;

}  // namespace

StatusOr<Digest> DigestOfFile(const AllowedFile& file, DigestCache& cache, const Clock& clock,
                              const Cancelled& cancelled) {
  const std::string& path = file.real_path();
  TESSERA_ASSIGN_OR_RETURN(const FileStamp before, file.Stamp());
  if (const auto known = cache.Find(path, before)) return *known;
  TESSERA_ASSIGN_OR_RETURN(const Digest digest, file.Hash(cancelled));
  TESSERA_ASSIGN_OR_RETURN(const FileStamp after, file.Stamp());
  if (!(before == after) || digest.size_bytes != after.size_bytes) {
    return absl::FailedPreconditionError(path + " changed while it was read");
  }
  if (after.modified_ns + kSettledNs < clock.UnixTimeUs() * 1000) {
    cache.Remember(path, after, digest).IgnoreError();  // without it the file is hashed again
  }
  return digest;
}

StatusOr<std::vector<NamedDigest>> DigestSceneFiles(const std::string& folder, const std::vector<std::string>& files,
                                                    const AllowedFiles& allowed, DigestCache& cache, const Clock& clock,
                                                    const Cancelled& cancelled) {
  std::vector<NamedDigest> digests(files.size());
  std::vector<Status> statuses(files.size());
  ParallelForEach(files.size(), 1, [&](size_t i) {
    const auto file = allowed.Open(folder + "/" + files[i]);
    const auto digest = file.ok() ? DigestOfFile(*file, cache, clock, cancelled) : file.status();
    statuses[i] = digest.status();
    if (digest.ok()) digests[i] = {files[i], *digest};
  });
  Faults faults;
  for (const Status& status : statuses) {
    if (absl::IsCancelled(status)) return status;
    faults.Add(status);
  }
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  return digests;
}

}  // namespace tessera
