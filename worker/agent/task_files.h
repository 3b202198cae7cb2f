// The files of a task: links its inputs into its folder and stores its outputs as blobs.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "common/base/retry/retry.h"
#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/rpc/blob_client.h"
#include "common/storage/files.h"
#include "common/storage/folder_blobs.h"
#include "worker/agent/blob_cache.h"
#include "worker/agent/coordinator_link.h"
#include "worker/agent/failure.h"

namespace tessera {

// The status's text without its code.
std::string MessageOf(const Status& status);

// An input is a link to the shared file, if that is readable and has the right content (hashed once per path, size and
// change time), else to the cache, which is filled from the blob service. Blobs get hard links if possible, which are
// faster than symbolic links; scene files get symbolic links. Outputs are moved to the shared blob folder if there is
// one, else uploaded. Several files are moved at once; results and errors do not depend on their order in time. Not
// thread-safe.
class TaskFiles {
 public:
  struct StorageWait {
    double limit_s = 600;
    RetryPolicy retry = {};
    Sleeper sleeper = RealSleeper();
  };

  // `use_shared_storage` false: shared paths are never accessed.
  // `storage_wait`: delays between attempts to store an output in a full store; the sleeper returns false to cancel.
  TaskFiles(BlobClient blobs, std::unique_ptr<BlobCache> cache, bool use_shared_storage,
            const StorageWait& storage_wait)
      : blobs_(std::move(blobs)),
        cache_(std::move(cache)),
        use_shared_storage_(use_shared_storage),
        storage_wait_(storage_wait) {}

  // Tests whether this worker shares the blob folder that the registration names. True if it does.
  bool Probe(const Registration& registration);

  // The calls below return Failures (failure.h), or CANCELLED by `control`. Of several failures they return that of the
  // first file. `control` is called by one thread at a time.

  // Makes the link `input_dir`/NAME for every input; there must be no such file. Inputs of a task may be brought in
  // several calls. kInput for names outside it; kLostInput with all inputs that the coordinator lacks or that are
  // damaged; kScratch if there is no local space.
  Status BringInputs(const std::vector<TaskInput>& inputs, const std::string& input_dir, const TaskControl& control);

  // kLostInput with the brought inputs that changed since: the outputs may be wrong. `read`: hash all inputs again
  // instead of comparing size and change time.
  Status CheckInputs(bool read);

  // Moves the named files of `output_dir` to the store. Returns digests in the order of `names`. While the store is
  // full, reports the wait as the stage and retries within `storage_wait`, then returns kStorage.
  StatusOr<std::vector<NamedDigest>> StoreOutputs(const std::vector<std::string>& names, const std::string& output_dir,
                                                  const TaskControl& control);

  // Call after the task: removes the links of its inputs (subfolders stay for the next task) and releases the cache.
  void Release();

 private:
  struct VerifiedFile {
    FileStamp stamp;
    Digest digest;
  };
  struct UsedFile {
    std::string path;
    FileStamp stamp;
    Digest digest;
  };

  // Where the input may be in shared storage, whether it exists or not; the first is preferred.
  std::vector<std::string> SharedPaths(const TaskInput& input) const;
  // Path of the blob in the shared folder, whether it exists or not; empty if there is no such folder.
  std::string SharedPath(const Digest& digest) const;
  // The shared file with the input's content, if it has been hashed since it changed last.
  std::optional<UsedFile> KnownAt(const TaskInput& input);
  // Where the input may be read. Thread-safe, as all functions from here to StoreOutput but Link.
  StatusOr<UsedFile> Locate(const TaskInput& input, const TaskControl& control);
  std::optional<UsedFile> ReadableAt(const std::string& path, const Digest& digest);
  // The content of a shared file, if it has been hashed since it changed last.
  std::optional<Digest> VerifiedAt(const std::string& path, const FileStamp& stamp);
  void NoteVerified(const std::string& path, const FileStamp& stamp, const Digest& digest);
  Status Link(const std::string& file, const std::string& link, bool is_blob);
  StatusOr<Digest> StoreOnce(const std::string& path, const TaskControl& control);
  // Waits while the store is full. `report`: called with the stage meanwhile.
  StatusOr<Digest> StoreOutput(const std::string& path, const TaskControl& control,
                               const std::function<void(const std::string& stage)>& report);

  BlobClient blobs_;
  std::unique_ptr<BlobCache> cache_;
  const bool use_shared_storage_;
  const StorageWait storage_wait_;
  std::unique_ptr<BlobStore> shared_blobs_;  // null: blob service only
  std::mutex verified_mutex_;
  std::map<std::string, VerifiedFile> verified_;  // shared files, by path
  std::vector<UsedFile> in_use_;                  // inputs of the running task
  std::vector<std::string> links_;                // links to them
};

}  // namespace tessera
