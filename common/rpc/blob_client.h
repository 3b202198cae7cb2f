// Blobs to and from a coordinator: 1 MiB chunks, each checked, interrupted transfers go on where they stopped.
#ifndef TESSERA_COMMON_RPC_BLOB_CLIENT_H_
#define TESSERA_COMMON_RPC_BLOB_CLIENT_H_

#include <memory>
#include <string>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/rpc/retry.h"
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
  // `retry`: between attempts that brought nothing new; progress starts it afresh. The sleeper is called from the
  // thread of the transfer.
  BlobClient(std::shared_ptr<grpc::Channel> channel, const RetryPolicy& retry, Sleeper sleeper);

  // Brings a blob into `store`, from what an interrupted transfer left there on. A chunk that does not match its XXH3
  // is fetched again; the whole is stored only if it hashes to its digest (else DATA_LOSS, after one fresh start).
  // NOT_FOUND if the coordinator does not have it, CANCELLED by `control`, which is told the share that is here.
  Status Fetch(const Digest& digest, BlobStore& store, const TaskControl& control);

  // Sends the file at `path`, which has this digest, from what the coordinator already has on. Nothing is sent if it
  // has all. DATA_LOSS if the file's bytes do not hash to the digest. `control` as above.
  Status Send(const std::string& path, const Digest& digest, const TaskControl& control);

 private:
  struct Impl;

  Status FetchOnce(const Digest& digest, BlobStore& store, const TaskControl& control);
  Status SendOnce(const std::string& path, const Digest& digest, const TaskControl& control, int64_t* committed);

  std::shared_ptr<Impl> impl_;
};

}  // namespace tessera

#endif  // TESSERA_COMMON_RPC_BLOB_CLIENT_H_
