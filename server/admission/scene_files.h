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

// Whether the caller waits no longer for the answer. May be empty.
using Cancelled = std::function<bool()>;

// Digest of the open file: from the cache while its size and time of change are the same, else computed.
// FAILED_PRECONDITION if it changes while it is read; CANCELLED. Thread-safe.
StatusOr<Digest> DigestOfFile(const HeldFile& file, DigestCache& cache, const Clock& clock,
                              const Cancelled& cancelled = {});

// Digests of `files`, paths relative to `folder`, in their order; several are read at a time. INVALID_ARGUMENT lists
// every file that cannot be read or is not allowed. Thread-safe.
StatusOr<std::vector<NamedDigest>> DigestSceneFiles(const std::string& folder, const std::vector<std::string>& files,
                                                    const AllowedFiles& allowed, DigestCache& cache, const Clock& clock,
                                                    const Cancelled& cancelled = {});

}  // namespace tessera
