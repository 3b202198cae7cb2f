// Files that are no mesh of a known format, recognised by their first bytes, so that messages say what was given.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace tessera {

enum class ForeignKind {
  kMesh,
  kCaptureMesh,  // of formats that ContextCapture and iTwin Capture write
  kPoints,
  kPacked,
  kXml,  // of any kind
  kOther
};

struct ForeignContent {
  ForeignKind kind = ForeignKind::kOther;
  std::string name;    // "a binary STL file"
  std::string remedy;  // what the user can do instead
};

// `head`: the first bytes of a file of `size_bytes` bytes. None if they are those of a known mesh format, or unknown.
std::optional<ForeignContent> RecogniseForeignContent(std::string_view head, int64_t size_bytes);

}  // namespace tessera
