// Block files of any program: a table of readers, one row a format. To add a format, write a file with its reader and
// add a row to kBlockFormats in block_format.cc.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "common/base/status.h"
#include "common/blocks/block.h"
#include "common/blocks/photograph_files.h"

namespace tessera {

struct BlockReadOptions {
  int component = -1;                 // the component to read; -1: the one with most images
  PhotographSearch photographs = {};  // for formats that do not hold the sizes of images
};

struct BlockFormat {
  std::string_view name;   // for --format
  std::string_view title;  // for messages: the format and its programs
  // Whether the file or folder at `path` has this format, by its content.
  bool (*matches)(const std::string& path);
  // Adds every fault to `faults`, with file and place. What it returns then is incomplete.
  ImportedBlock (*read)(const std::string& path, const BlockReadOptions& options, Faults* faults, Warnings* warnings);
};

std::span<const BlockFormat> BlockFormats();

// Reads the block at `path`, a file or folder. `format`: a name of BlockFormats(); none: it is detected by content.
// INVALID_ARGUMENT with all faults; for a file of a known format that is not read, with what to export instead.
StatusOr<ImportedBlock> ReadBlock(const std::string& path, const std::optional<std::string>& format,
                                  const BlockReadOptions& options, Warnings* warnings);
// The same, but adds the faults to `faults`; the block is then incomplete.
ImportedBlock ReadBlock(const std::string& path, const std::optional<std::string>& format,
                        const BlockReadOptions& options, Faults* faults, Warnings* warnings);

}  // namespace tessera
