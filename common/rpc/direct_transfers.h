// Transfers blobs between this process and the coordinator's object store, by signed URLs from the coordinator.
#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "common/base/retry/retry.h"
#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/s3/s3_client.h"
#include "common/storage/blob_store.h"
#include "tessera/v1/blobs.grpc.pb.h"

namespace tessera {

// No bytes pass the coordinator, and the only credentials are those of the channel. Thread-safe. Include in .cc files
// only.
//
// UNAVAILABLE for an outage of the coordinator or the store, and for whatever the coordinator cannot change by a retry
// but a person can (a wrong clock, a bucket that is gone): the message has the store's reason.
class DirectTransfers {
 public:
  // `stub` must outlive this. `options`: of the connections to the store.
  DirectTransfers(v1::Blobs::Stub* stub, const S3ClientOptions& options);

  // Asks for the URLs of all these blobs at once, so that the calls of Fetch that follow need not. Errors are left to
  // Fetch.
  void Prepare(const std::vector<Digest>& digests);

  // Nullopt if the coordinator gives no URL: use the blob service. Else the result of one attempt to fetch the rest of
  // the blob into `store`, which resumes. DATA_LOSS if the bytes do not hash to the digest, though the stored ones do.
  // NOT_FOUND if the coordinator does not have the blob, or found it damaged.
  std::optional<Status> Fetch(const Digest& digest, BlobStore& store, const TaskControl& control);

  // The same for sending a file. DATA_LOSS if the hash of the file differs from the digest. RESOURCE_EXHAUSTED if the
  // store is full.
  std::optional<Status> Send(const std::string& path, const Digest& digest, const TaskControl& control);

 private:
  using Steady = std::chrono::steady_clock;
  struct Prepared {
    SignedRequest request;
    Steady::time_point until;
  };

  StatusOr<v1::GetTransfersResponse> Ask(const v1::GetTransfersRequest& request);
  // The request to read the blob, prepared or new. Nullopt if there is none. `check`: see GetTransfersRequest.
  StatusOr<std::optional<SignedRequest>> RequestFor(const Digest& digest, bool check);
  Status FetchRest(const Digest& digest, BlobStore& store, const TaskControl& control, const SignedRequest& request);
  Status SendParts(const std::string& path, const Digest& digest, const TaskControl& control, int64_t part_bytes);

  v1::Blobs::Stub* const stub_;
  SignedTransfers transfers_;
  std::atomic<Steady::rep> ask_again_at_ = 0;  // there was no object store; steady clock
  std::mutex mutex_;
  std::map<std::string, Prepared> prepared_;  // by SHA-256
};

}  // namespace tessera
