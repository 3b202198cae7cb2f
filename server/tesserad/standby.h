// Becoming the active coordinator of a state, and ending once another one may have taken over.
#pragma once

#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "common/base/status.h"
#include "common/storage/hash.h"

namespace tessera {

class BlobStore;
class StateStore;

// What all coordinators of a state must share, because jobs of one are continued by another.
struct SharedStorage {
  BlobStore* blobs = nullptr;
  // Absolute paths and URLs, s3://BUCKET/PREFIX. Without a path: files of the process's user.
  std::vector<std::string> scene_roots;
  // Take `blobs` although it is not the store that the state was used with: results that it lacks are recomputed.
  bool accept_blobs = false;
};

// Opens the state at `url`. While another coordinator is active, waits as its standby; nullptr if `stop` returned true.
// `stop` is called about four times a second. INVALID_ARGUMENT if the active coordinator uses another blob store, or
// has scene roots that this one lacks. Errors of OpenState.
StatusOr<std::unique_ptr<StateStore>> AwaitState(const std::string& url, const SharedStorage& storage,
                                                 const std::function<bool()>& stop);

// Records in the state what this coordinator shares: its scene roots, and a probe object of random content in its blob
// store. Returns the probe, a blob that nothing refers to and that must stay. INVALID_ARGUMENT if the state was used
// with another blob store.
StatusOr<Digest> MarkStorage(StateStore& store, const SharedStorage& storage);

// Exit code of a coordinator that was replaced (EX_TEMPFAIL): started again, it stands by.
inline constexpr int kReplacedExitCode = 75;

// Logs the reason and ends the process at once, without another answer to anybody.
[[noreturn]] void EndReplaced(const Status& reason);

// Ends the process as soon as the right to write the state is no longer certain. Thread-safe.
class RightWatch {
 public:
  // `store` must outlive the watch. `end`: EndReplaced, or a replacement in tests.
  explicit RightWatch(const StateStore& store, std::function<void(const Status& reason)> end = EndReplaced);
  ~RightWatch();

  // Ends the process if the right is not certain now. For a process that was stopped: its threads run on before this
  // class's own thread has noticed.
  void Check() const;

 private:
  void Run();

  const StateStore& store_;
  const std::function<void(const Status& reason)> end_;
  std::mutex mutex_;
  std::condition_variable stopped_;
  bool stop_ = false;
  std::thread thread_;  // last: uses all others
};

}  // namespace tessera
