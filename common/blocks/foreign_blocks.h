// Files of photogrammetry programs that are no block of a known format, recognised by content, so that the refusal says
// what to export instead.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace tessera {

struct ForeignBlock {
  std::string name;    // "a Bundler file"
  std::string remedy;  // what to export instead
};

// `name`: of the file; it decides only for project files whose content does not say what they are. `head`: its first
// bytes, at least 4096 if it has that many. None if the content is not known.
std::optional<ForeignBlock> RecogniseForeignBlock(std::string_view name, std::string_view head);

// The same for the file at `path`; for a folder, of the first of its files that is known (3 levels, 2000 entries).
std::optional<ForeignBlock> FindForeignBlock(const std::string& path);

}  // namespace tessera
