// Maintenance of a data folder: backup, verification and salvage. Results go to standard output.
#pragma once

#include <string>

#include "common/base/status.h"
#include "server/tesserad/open_blobs.h"

namespace tessera {

// Copies the database of a data folder to one file. The coordinator may be running.
Status BackUpData(const std::string& data, const std::string& to);

// Prints every fault and returns DATA_LOSS if there is one. Quarantines unusable records, as a start would. The folder
// must not be in use.
Status VerifyData(const std::string& data, const BlobFlags& blob_flags, bool deep);

// Replaces a damaged database by one with its readable records. The folder must not be in use.
Status SalvageData(const std::string& data);

}  // namespace tessera
