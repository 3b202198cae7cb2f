// The files of a blob store's folder, to find those that nobody needs, and how one is taken away.
#ifndef TESSERA_COMMON_STORAGE_BLOB_SWEEP_H_
#define TESSERA_COMMON_STORAGE_BLOB_SWEEP_H_

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

struct BlobFile {
  enum class Kind {
    kBlob,
    kLeftover,  // of an unfinished write
    kSetAside,  // a blob that was damaged: see BlobStore::VerifyOrSetAside
  };
  std::string path;
  Kind kind = Kind::kBlob;
  std::string sha256;  // of a blob
  int64_t size_bytes = 0;
  int64_t since_us = 0;  // Unix time: last stored or read; of what was set aside: when it was
};

// A blob folder is listed in so many parts, of which each is small.
inline constexpr int kBlobParts = 258;

// Files of part `part` of the folder `root`, of which some may be gone already. What is of no kind is not listed.
// Thread-safe.
std::vector<BlobFile> ListBlobFiles(const std::string& root, int part);

// Takes a listed file out of the store at once. Gives where it lies now, still to be removed, which may take long. If
// that is never done, it is listed as left by a write. NOT_FOUND if the file is gone, or a blob was stored again since
// it was listed: whoever did that counts on it.
StatusOr<std::string> TakeOut(const std::string& root, const BlobFile& file);

}  // namespace tessera

#endif  // TESSERA_COMMON_STORAGE_BLOB_SWEEP_H_
