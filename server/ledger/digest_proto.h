// Conversion of digests to and from protobuf messages. Include it in .cc files only.
#pragma once

#include <vector>

#include "common/storage/hash.h"
#include "tessera/v1/blobs.pb.h"

namespace tessera {

// Does not check the digest.
inline Digest FromProto(const v1::Digest& digest) { return {digest.sha256(), digest.size_bytes()}; }

inline void ToProto(const Digest& digest, v1::Digest* proto) {
  proto->set_sha256(digest.sha256);
  proto->set_size_bytes(digest.size_bytes);
}

// `List`: repeated messages with a name and a digest.
template <class List>
std::vector<NamedDigest> NamedDigests(const List& files) {
  std::vector<NamedDigest> result;
  for (const auto& file : files) result.push_back({file.name(), FromProto(file.digest())});
  return result;
}

// `files`: NamedDigest or a type that converts to it.
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
