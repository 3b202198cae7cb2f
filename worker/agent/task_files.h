// The files of a task: inputs come into its folder, outputs go to the coordinator's blobs.
#ifndef TESSERA_WORKER_AGENT_TASK_FILES_H_
#define TESSERA_WORKER_AGENT_TASK_FILES_H_

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/rpc/blob_client.h"
#include "common/rpc/retry.h"
#include "common/storage/blob_store.h"
#include "common/storage/files.h"
#include "worker/agent/blob_cache.h"
#include "worker/agent/coordinator_link.h"
#include "worker/agent/failure.h"

namespace tessera {

// The status's text without its code.
std::string MessageOf(const Status& status);

// Inputs are links: to the shared file where it can be read and has the right content (hashed once for each path, size
// and time of change), else to the cache, filled by the blob service. Blobs get hard links where the file system has
// them, since a task of one step has dozens and to make and drop as many files would cost more than the rest of
// dispatch; files of a scene, which are the user's, symbolic ones. Outputs are written to the shared blob folder where
// there is one, else sent. Not thread-safe.
class TaskFiles {
 public:
  struct StorageWait {
    double limit_s = 600;
    RetryPolicy retry = {};
    Sleeper sleeper = RealSleeper();
  };

  // `use_shared_storage` false: shared paths are never touched.
  // `storage_wait`: between attempts to store an output for which there is no room; the sleeper gives up by false.
  TaskFiles(BlobClient blobs, std::unique_ptr<BlobCache> cache, bool use_shared_storage,
            const StorageWait& storage_wait)
      : blobs_(std::move(blobs)),
        cache_(std::move(cache)),
        use_shared_storage_(use_shared_storage),
        storage_wait_(storage_wait) {}

  // Learns from a registration whether this worker shares the coordinator's blob folder. True if it does.
  bool Probe(const Registration& registration);

  // Errors of these are Failures (failure.h), or CANCELLED by `control`.

  // Makes `input_dir`/NAME for every input, in a folder that holds nothing else but perhaps folders without files.
  // kInput for names that leave the folder, kLostInput with all that the coordinator does not have either, or not as it
  // was, kScratch if there is no room for them here.
  Status BringInputs(const std::vector<TaskInput>& inputs, const std::string& input_dir, const TaskControl& control);

  // kLostInput with those that were changed since BringInputs: what was made of them cannot be trusted. `read`: hashes
  // all of them again, whatever their times of change say.
  Status CheckInputs(bool read);

  // Stores the named files of `output_dir`, which are moved away. In the order of `names`. While there is no room for
  // them it waits, as `storage_wait` says, and tells so as the stage; then kStorage.
  StatusOr<std::vector<NamedDigest>> StoreOutputs(const std::vector<std::string>& names, const std::string& output_dir,
                                                  const TaskControl& control);

  // The task has ended: takes its inputs out of their folder, whose own folders stay for the next task's; they may
  // leave the cache.
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

  // Path where the input may be read.
  StatusOr<std::string> Locate(const TaskInput& input, const TaskControl& control);
  bool ReadableAt(const std::string& path, const Digest& digest);
  Status Link(const std::string& file, const std::string& link, bool is_blob);
  StatusOr<Digest> StoreOnce(const std::string& path, const TaskControl& control);
  StatusOr<Digest> StoreOutput(const std::string& path, const TaskControl& moving, const TaskControl& control);

  BlobClient blobs_;
  std::unique_ptr<BlobCache> cache_;
  const bool use_shared_storage_;
  const StorageWait storage_wait_;
  std::unique_ptr<BlobStore> shared_blobs_;       // null: blob service only
  std::map<std::string, VerifiedFile> verified_;  // shared files, by path
  std::vector<UsedFile> in_use_;                  // the running task's inputs, where they are
  std::vector<std::string> links_;                // and as it sees them
};

}  // namespace tessera

#endif  // TESSERA_WORKER_AGENT_TASK_FILES_H_
