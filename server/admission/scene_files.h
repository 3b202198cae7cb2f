// Digests of a scene's files, cached while the files do not change.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/storage/allowed_files.h"
#include "common/storage/hash.h"
#include "server/store/record_store.h"

namespace tessera {

// Returns true once the caller has cancelled. May be empty.
using Cancelled = std::function<bool()>;

// Digest of the open file: cached if its size and change time are unchanged, else computed. FAILED_PRECONDITION if it
// changes while it is read; CANCELLED by `cancelled`. Thread-safe.
StatusOr<Digest> DigestOfFile(const AllowedFile& file, DigestCache& cache, const Clock& clock,
                              const Cancelled& cancelled = {});

// Digests of `files` (paths relative to `folder`), in the same order. Reads several files concurrently.
// INVALID_ARGUMENT lists every file that cannot be read or is not allowed. Thread-safe.
StatusOr<std::vector<NamedDigest>> DigestSceneFiles(const std::string& folder, const std::vector<std::string>& files,
                                                    const AllowedFiles& allowed, DigestCache& cache, const Clock& clock,
                                                    const Cancelled& cancelled = {});

}  // namespace tessera
