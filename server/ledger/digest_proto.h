// Contents as messages and records have them. Included by .cc files only.
#pragma once

#include <vector>

#include "common/storage/hash.h"
#include "tessera/v1/blobs.pb.h"

namespace tessera {

// Not checked.
inline Digest FromProto(const v1::Digest& digest) { return {digest.sha256(), digest.size_bytes()}; }

inline void ToProto(const Digest& digest, v1::Digest* proto) {
  proto->set_sha256(digest.sha256);
  proto->set_size_bytes(digest.size_bytes);
}

// `List`: of messages with a name and a digest.
template <class List>
std::vector<NamedDigest> NamedDigests(const List& files) {
  std::vector<NamedDigest> result;
  for (const auto& file : files) result.push_back({file.name(), FromProto(file.digest())});
  return result;
}

// `files`: NamedDigests, or what becomes one.
template <class Files, class List>
void AddFiles(const Files& files, List* list) {
  for (const auto& each : files) {
    const NamedDigest& file = each;
    auto* added = list->Add();
    added->set_name(file.name);
    ToProto(file.digest, added->mutable_digest());
  }
}

}  // namespace tessera
