#include "server/tesserad/standby.h"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "common/access/secrets.h"
#include "common/log/log.h"
#include "common/storage/blob_store.h"
#include "server/ledger/record_owner.h"
#include "server/store/state_store.h"
#include "server/tesserad/notify.h"

namespace tessera {
namespace {

constexpr std::chrono::milliseconds kWatch{50};
// Names of the values that are kept with the state.
constexpr char kBlobProbe[] = "blob_probe";    // content of the probe object
constexpr char kSceneRoots[] = "scene_roots";  // of the last active coordinator, one a line

std::string ThisProcess() {
  char host[256] = {};
  if (::gethostname(host, sizeof(host) - 1) != 0) host[0] = '?';
  return absl::StrCat(host, ", process ", ::getpid());
}

// Whether the folder `path` is `root` or inside it. Both absolute.
bool IsUnder(const std::string& path, const std::string& root) {
  return path == root || path.starts_with(root.ends_with('/') ? root : root + "/");
}

Digest DigestOf(const std::string& probe) { return {Sha256Hex(probe), static_cast<int64_t>(probe.size())}; }

// INVALID_ARGUMENT if the store does not have the probe object; other errors if it cannot be read now.
Status CheckBlobs(const std::string& probe, const BlobStore& blobs) {
  const auto found = blobs.Read(DigestOf(probe));
  if (found.ok() && *found == probe) return absl::OkStatus();
  if (!found.ok() && !absl::IsNotFound(found.status()) && !absl::IsDataLoss(found.status())) return found.status();
  return InputError("--blobs", "", blobs.Location() + ", which lacks the probe object of this state",
                    "the blob store that the state was used with; if its content is lost, pass --accept-blobs to "
                    "compute it again");
}

// INVALID_ARGUMENT if one of the active coordinator's roots is in none of `roots`.
Status CheckSceneRoots(const std::string& active, const std::vector<std::string>& roots) {
  const std::vector<std::string> paths = absl::StrSplit(active, '\n', absl::SkipEmpty());
  for (const std::string& path : paths) {
    if (std::any_of(roots.begin(), roots.end(), [&](const std::string& root) { return IsUnder(path, root); })) continue;
    return InputError("--scene-root", "", roots.empty() ? "none" : absl::StrJoin(roots, ", "),
                      path + " as well, which the active coordinator has");
  }
  return absl::OkStatus();
}

Status CheckIsLikeActive(const std::string& url, const SharedStorage& storage) {
  TESSERA_ASSIGN_OR_RETURN(const std::optional<std::string> probe, ReadKept(url, kBlobProbe));
  if (probe && !storage.accept_blobs) TESSERA_RETURN_IF_ERROR(CheckBlobs(*probe, *storage.blobs));
  TESSERA_ASSIGN_OR_RETURN(const std::optional<std::string> roots, ReadKept(url, kSceneRoots));
  return CheckSceneRoots(roots.value_or(""), storage.scene_roots);
}

}  // namespace

StatusOr<std::unique_ptr<StateStore>> AwaitState(const std::string& url, const SharedStorage& storage,
                                                 const std::function<bool()>& stop) {
  bool stopped = false, checked = false;
  Status unfit;
  OpenStateOptions options;
  options.owner_of = OwnerOfRecord;
  options.holder = ThisProcess();
  options.wait = [&](const std::string& holder, double renewed_before_s) {
    if (!checked) {
      unfit = CheckIsLikeActive(url, storage);
      checked = unfit.ok();
      if (checked) {
        LogInfo("coordinator stands by", {{"active", holder}, {"renewed_before_s", absl::StrCat(renewed_before_s)}});
        NotifyReady();
      } else if (!absl::IsInvalidArgument(unfit)) {
        LogWarning("standby cannot be checked; retrying", {{"reason", std::string(unfit.message())}});
      }
    }
    stopped = stop();
    return !stopped && !absl::IsInvalidArgument(unfit);
  };
  auto store = OpenState(url, options);
  if (absl::IsInvalidArgument(unfit)) return unfit;
  if (stopped) return nullptr;
  return store;
}

StatusOr<Digest> MarkStorage(StateStore& store, const SharedStorage& storage) {
  const std::string own = RandomSecret();
  TESSERA_RETURN_IF_ERROR(storage.blobs->PutBytes(own).status());  // before the state names it
  TESSERA_ASSIGN_OR_RETURN(const std::string probe, store.Keep(kBlobProbe, own));
  if (probe != own && storage.accept_blobs) TESSERA_RETURN_IF_ERROR(storage.blobs->PutBytes(probe).status());
  TESSERA_RETURN_IF_ERROR(CheckBlobs(probe, *storage.blobs));
  TESSERA_RETURN_IF_ERROR(store.Replace(kSceneRoots, absl::StrJoin(storage.scene_roots, "\n")));
  return DigestOf(probe);
}

void EndReplaced(const Status& reason) {
  LogError("another coordinator has taken over, or may have: this one ends",
           {{"reason", std::string(reason.message())}});
  ::_exit(kReplacedExitCode);
}

RightWatch::RightWatch(const StateStore& store, std::function<void(const Status& reason)> end)
    : store_(store), end_(std::move(end)), thread_([this] { Run(); }) {}

RightWatch::~RightWatch() {
  {
    std::lock_guard lock(mutex_);
    stop_ = true;
  }
  stopped_.notify_all();
  thread_.join();
}

void RightWatch::Check() const {
  if (store_.HeldFor_s() <= 0) end_(absl::AbortedError(store_.Location() + ": could not renew the right to write"));
}

void RightWatch::Run() {
  std::unique_lock lock(mutex_);
  while (!stopped_.wait_for(lock, kWatch, [this] { return stop_; })) Check();
}

}  // namespace tessera
