// Archives without compression (common/storage/zip_writer.h) whose members are read as ranges of the archive.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>

#include "common/base/status.h"

namespace tessera {

struct ZipMember {
  int64_t offset_bytes = 0, size_bytes = 0;  // of its content in the archive
};
using ZipDirectory = std::map<std::string, ZipMember>;

// Reads the archive's directory. `read`: bytes of the archive from an offset, exactly as many as are asked for.
// DATA_LOSS for what is no such archive, has more than 100,000 members or a directory of more than 16 MiB.
StatusOr<ZipDirectory> ReadZipDirectory(
    int64_t archive_bytes, const std::function<StatusOr<std::string>(int64_t offset_bytes, int64_t size_bytes)>& read);

}  // namespace tessera
