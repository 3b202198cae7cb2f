#include "common/blocks/block_format.h"

#include <array>

#include "absl/strings/str_cat.h"
#include "common/blocks/blocks_exchange.h"
#include "common/blocks/metashape.h"

namespace tessera {
namespace {

// A format whose content is a special case of another's comes first.
constexpr auto kBlockFormats = std::to_array<BlockFormat>({
    {"blocksexchange", "BlocksExchange of ContextCapture or iTwin Capture", IsBlocksExchange, ReadBlocksExchange},
    {"metashape", "cameras or project of PhotoScan or Metashape", IsMetashape, ReadMetashape},
});

}  // namespace

std::span<const BlockFormat> BlockFormats() { return kBlockFormats; }

StatusOr<ImportedBlock> ReadBlock(const std::string& path, const std::optional<std::string>& format,
                                  const BlockReadOptions& options, Warnings* warnings) {
  std::string names;
  for (const BlockFormat& row : kBlockFormats) {
    names += absl::StrCat(names.empty() ? "" : ", ", std::string(row.name));
    if (format.has_value() ? *format != row.name : !row.matches(path)) continue;
    Faults faults;
    ImportedBlock block = row.read(path, options, &faults, warnings);
    TESSERA_RETURN_IF_ERROR(faults.ToStatus());
    block.format = row.name;
    return block;
  }
  if (format.has_value()) return InputError("--format", "", absl::StrCat("'", *format, "'"), names);
  return InputError(path, "", "no block of a known format", absl::StrCat("one of ", names));
}

}  // namespace tessera
