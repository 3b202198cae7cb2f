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
#include "common/storage/blob_store.h"
#include "common/storage/files.h"
#include "worker/agent/blob_cache.h"
#include "worker/agent/coordinator_link.h"

namespace tessera {

// Inputs are links: to the shared file where it can be read and has the right content (hashed once for each path, size
// and time of change), else to the cache, filled by the blob service. Blobs get hard links where the file system has
// them, since a task of one step has dozens and to make and drop as many files would cost more than the rest of
// dispatch; files of a scene, which are the user's, symbolic ones. Outputs are written to the shared blob folder where
// there is one, else sent. Not thread-safe.
class TaskFiles {
 public:
  // `use_shared_storage` false: shared paths are never touched.
  TaskFiles(BlobClient blobs, std::unique_ptr<BlobCache> cache, bool use_shared_storage)
      : blobs_(std::move(blobs)), cache_(std::move(cache)), use_shared_storage_(use_shared_storage) {}

  // Learns from a registration whether this worker shares the coordinator's blob folder. True if it does.
  bool Probe(const Registration& registration);

  // Makes `input_dir`/NAME for every input, in a folder that holds nothing else but perhaps folders without files.
  // INVALID_ARGUMENT for names that leave the folder, NOT_FOUND if the
  // coordinator does not have the content either; a full disk is UNAVAILABLE here, never a lack of memory.
  Status BringInputs(const std::vector<TaskInput>& inputs, const std::string& input_dir, const TaskControl& control);

  // INVALID_ARGUMENT if a shared input was changed since BringInputs: what was made of it cannot be trusted.
  Status CheckInputsUnchanged() const;

  // Stores the named files of `output_dir`, which are moved away. In the order of `names`.
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

  // Path where the input may be read.
  StatusOr<std::string> Locate(const TaskInput& input, const TaskControl& control);
  bool ReadableAt(const std::string& path, const Digest& digest);
  Status Link(const std::string& file, const std::string& link, bool is_blob);
  StatusOr<Digest> StoreOutput(const std::string& path, const TaskControl& control);

  BlobClient blobs_;
  std::unique_ptr<BlobCache> cache_;
  const bool use_shared_storage_;
  std::unique_ptr<BlobStore> shared_blobs_;                // null: blob service only
  std::map<std::string, VerifiedFile> verified_;           // shared files, by path
  std::vector<std::pair<std::string, FileStamp>> in_use_;  // shared files of the running task
  std::vector<std::string> links_;                         // the running task's inputs
};

}  // namespace tessera

#endif  // TESSERA_WORKER_AGENT_TASK_FILES_H_
