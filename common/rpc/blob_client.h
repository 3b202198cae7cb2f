// Transfers blobs of a coordinator: directly to and from its object store, by signed URLs, or through its blob service
// in checksummed chunks of 1 MiB. Interrupted transfers resume.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "common/base/retry/retry.h"
#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/storage/blob_store.h"
#include "common/storage/hash.h"

namespace grpc {
class Channel;
}  // namespace grpc

namespace tessera {

inline constexpr int64_t kBlobChunkBytes = int64_t{1} << 20;

// Thread-safe.
class BlobClient {
 public:
  // `retry` limits attempts without progress; progress resets it. `sleeper` is called on the thread of the transfer.
  // `ca_file`: certificate authorities of the object store, PEM; empty: the system's.
  BlobClient(std::shared_ptr<grpc::Channel> channel, const RetryPolicy& retry, Sleeper sleeper,
             const std::string& ca_file = "");

  // Asks for the URLs of several blobs at once. Optional: saves a call for each Fetch that follows within minutes.
  void Prepare(const std::vector<Digest>& digests);

  // Fetches a blob into `store`; resumes an interrupted transfer. A chunk whose XXH3 differs is fetched again. The blob
  // is stored only if its hash equals the digest, else it is fetched once more from the start, then DATA_LOSS.
  // NOT_FOUND if the coordinator does not have it. CANCELLED by `control`, which also receives the fetched share and,
  // as the stage, why an attempt is repeated.
  Status Fetch(const Digest& digest, BlobStore& store, const TaskControl& control);

  // Sends the file at `path`, whose digest is `digest`. Skips the bytes that the coordinator already has. DATA_LOSS if
  // the hash of the file differs from the digest. `control` as above.
  Status Send(const std::string& path, const Digest& digest, const TaskControl& control);

 private:
  struct Impl;

  Status FetchOnce(const Digest& digest, BlobStore& store, const TaskControl& control);
  Status SendOnce(const std::string& path, const Digest& digest, const TaskControl& control, int64_t* committed);

  std::shared_ptr<Impl> impl_;
};

}  // namespace tessera
