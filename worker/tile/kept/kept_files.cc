#include "worker/tile/kept/kept_files.h"

#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <iterator>
#include <list>
#include <mutex>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/machine_limits.h"

namespace tessera {
namespace {

// Bound on the bytes of the kept files of one kind.
int64_t KeptLimit_bytes() {
  static const int64_t limit = std::min(MemoryLimit_bytes() / 64, int64_t{256} << 20);
  return limit;
}

std::string KeyOf(const struct stat& file) {
  return absl::StrCat(file.st_dev, "|", file.st_ino, "|", file.st_size, "|", file.st_mtim.tv_sec, "|",
                      file.st_mtim.tv_nsec);
}

StatusOr<struct stat> StatOf(const std::string& path) {
  struct stat file = {};
  if (stat(path.c_str(), &file) != 0) return absl::NotFoundError(path + ": " + std::strerror(errno));
  return file;
}

int TileOf(const MappedState& state) { return state.spans().tile; }
int TileOf(const TileSums& sums) { return sums.tile; }

template <class T>
class KeptFiles {
 public:
  // Calls read(path) unless the content is kept.
  template <class Read>
  StatusOr<std::shared_ptr<const T>> Open(const std::string& path, const Read& read) {
    TESSERA_ASSIGN_OR_RETURN(const struct stat file, StatOf(path));
    const std::string key = KeyOf(file);
    {
      const std::lock_guard lock(mutex_);
      const auto found = std::find_if(kept_.begin(), kept_.end(), [&](const Kept& kept) { return kept.key == key; });
      if (found != kept_.end()) {
        kept_.splice(kept_.begin(), kept_, found);
        return found->content;
      }
    }
    TESSERA_ASSIGN_OR_RETURN(T content, read(path));
    auto shared = std::make_shared<const T>(std::move(content));
    const std::lock_guard lock(mutex_);
    const int tile = TileOf(*shared);
    kept_.remove_if([&](const Kept& kept) { return TileOf(*kept.content) == tile; });
    kept_.push_front({key, file.st_size, shared});
    int64_t bytes = 0;
    for (auto it = kept_.begin(); it != kept_.end();) {
      bytes += it->bytes;
      it = bytes > KeptLimit_bytes() ? kept_.erase(it) : std::next(it);
    }
    return shared;
  }

 private:
  struct Kept {
    std::string key;
    int64_t bytes;
    std::shared_ptr<const T> content;
  };
  std::mutex mutex_;
  std::list<Kept> kept_;  // most recently used first
};

}  // namespace

StatusOr<std::string> ContentKey(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const struct stat file, StatOf(path));
  return KeyOf(file);
}

StatusOr<std::shared_ptr<const MappedState>> OpenState(const std::string& path) {
  static auto* const kept = new KeptFiles<MappedState>;
  return kept->Open(path, MappedState::Open);
}

StatusOr<std::shared_ptr<const TileSums>> OpenSums(const std::string& path) {
  static auto* const kept = new KeptFiles<TileSums>;
  return kept->Open(path, ReadTileSums);
}

}  // namespace tessera
