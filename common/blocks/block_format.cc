#include "common/blocks/block_format.h"

#include "absl/strings/str_cat.h"
#include "common/blocks/blocks_exchange/blocks_exchange.h"
#include "common/blocks/colmap_block.h"
#include "common/blocks/foreign_blocks.h"
#include "common/blocks/metashape/metashape.h"
#include "common/blocks/nvm.h"
#include "common/blocks/openmvs.h"
#include "common/blocks/opensfm/opensfm.h"
#include "common/blocks/pix4d/pix4d.h"
#include "common/blocks/realityscan/realityscan.h"

namespace tessera {
namespace {

// A format whose content is a special case of another's comes first.
constexpr BlockFormat kBlockFormats[] = {
    {"blocksexchange", "BlocksExchange of ContextCapture or iTwin Capture", IsBlocksExchange, ReadBlocksExchange},
    {"metashape", "cameras or project of PhotoScan or Metashape", IsMetashape, ReadMetashape},
    {"opendronemap", "OpenDroneMap project, OpenSfM reconstruction", IsOpenSfm, ReadOpenSfm},
    {"openmvs", "OpenMVS's interface (MVSI)", IsOpenMvs, ReadOpenMvs},
    {"colmap", "COLMAP sparse model", IsColmapBlock, ReadColmapBlock},
    {"pix4d", "Pix4D's calibrated_camera_parameters.txt", IsPix4d, ReadPix4d},
    {"nvm", "NVM of VisualSFM, COLMAP or OpenSfM", IsNvm, ReadNvm},
    {"realityscan", "RealityScan's XMP sidecars or table of camera parameters", IsRealityScan, ReadRealityScan},
};

}  // namespace

std::span<const BlockFormat> BlockFormats() { return kBlockFormats; }

StatusOr<ImportedBlock> ReadBlock(const std::string& path, const std::optional<std::string>& format,
                                  const BlockReadOptions& options, Warnings* warnings) {
  Faults faults;
  ImportedBlock block = ReadBlock(path, format, options, &faults, warnings);
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  return block;
}

ImportedBlock ReadBlock(const std::string& path, const std::optional<std::string>& format,
                        const BlockReadOptions& options, Faults* faults, Warnings* warnings) {
  std::string names;
  for (const BlockFormat& row : kBlockFormats) {
    names += absl::StrCat(names.empty() ? "" : ", ", std::string(row.name));
    if (format.has_value() ? *format != row.name : !row.matches(path)) continue;
    ImportedBlock block = row.read(path, options, faults, warnings);
    block.format = row.name;
    return block;
  }
  if (format.has_value()) {
    faults->Add(InputError("--format", "", absl::StrCat("'", *format, "'"), names));
  } else if (const std::optional<ForeignBlock> foreign = FindForeignBlock(path)) {
    faults->Add(InputError(path, "", foreign->name, foreign->remedy));
  } else {
    faults->Add(InputError(path, "", "no block of a known format", absl::StrCat("one of ", names)));
  }
  return {};
}

}  // namespace tessera
