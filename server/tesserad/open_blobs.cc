#include "server/tesserad/open_blobs.h"

#include <optional>
#include <utility>

#include "common/log/log.h"
#include "common/storage/files.h"
#include "common/storage/folder_blobs.h"

namespace tessera {

StatusOr<OpenedBlobs> OpenBlobs(const BlobFlags& flags, const std::string& data, double grace_s, const Clock* clock) {
  OpenedBlobs opened;
  if (!IsS3Url(flags.url)) {
    if (flags.url.find("://") != std::string::npos) {
      return InputError("--blobs", "", flags.url, "a folder or s3://BUCKET/PREFIX");
    }
    opened.folder = flags.url.empty() ? data + "/blobs" : AbsolutePath(flags.url);
    TESSERA_ASSIGN_OR_RETURN(opened.store, FolderBlobs::Open(opened.folder));
    return opened;
  }
  TESSERA_ASSIGN_OR_RETURN(const S3Location location, ParseS3Url(flags.url, flags.endpoint, flags.region));
  opened.credentials = DefaultS3Credentials(clock);
  S3ClientOptions options;
  options.ca_file = flags.ca_file;
  TESSERA_ASSIGN_OR_RETURN(opened.client, S3Client::Create(location, opened.credentials.get(), clock, options));
  TESSERA_ASSIGN_OR_RETURN(
      opened.remover, S3Client::Create(location, opened.credentials.get(), clock, S3Blobs::RemovalOptions(options)));
  TESSERA_ASSIGN_OR_RETURN(auto store, S3Blobs::Open(opened.client.get(), clock, data + "/staging", grace_s));
  store->RemoveBy(opened.remover.get());
  opened.store = std::move(store);
  opened.counts = [client = opened.client.get(), remover = opened.remover.get()] {
    std::map<std::string, S3Counts> counts = client->counts();
    AddCounts(remover->counts(), &counts);
    return counts;
  };
  return opened;
}

StatusOr<OpenedScenes> OpenStoredScenes(const std::vector<std::string>& roots, const BlobFlags& flags,
                                        const Clock* clock) {
  std::vector<std::string> urls;
  for (const std::string& root : roots) {
    if (IsS3Url(root)) urls.push_back(root);
  }
  OpenedScenes opened;
  if (urls.empty()) return opened;
  opened.credentials = DefaultS3Credentials(clock);
  S3ClientOptions options;
  options.ca_file = flags.ca_file;
  TESSERA_ASSIGN_OR_RETURN(
      opened.scenes, StoredScenes::Open(urls, flags.endpoint, flags.region, opened.credentials.get(), clock, options));
  return opened;
}

Status OpenTransfers(OpenedBlobs& blobs, const std::string& data) {
  if (blobs.client == nullptr) return absl::OkStatus();
  TESSERA_ASSIGN_OR_RETURN(const std::optional<SignedHash> hash, TryUploads(*blobs.client, data));
  const LogFields store = {{"blobs", blobs.store->Location()}};
  if (!hash) {
    LogEvent(LogLevel::kWarning,
             "the object store refuses uploads by signed URLs: results of workers pass the coordinator", store);
  } else if (*hash == SignedHash::kNone) {
    LogEvent(LogLevel::kWarning,
             "the object store does not check hashes of uploads by signed URLs: damage is found when results are read",
             store);
  } else {
    LogEvent(LogLevel::kInfo, "workers store results in the object store, which checks their hashes", store);
  }
  blobs.transfers = std::make_unique<BlobTransfers>(blobs.client.get(), static_cast<S3Blobs*>(blobs.store.get()), hash);
  return absl::OkStatus();
}

}  // namespace tessera
