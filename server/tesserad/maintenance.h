// Maintenance of a coordinator's state: backup, verification, salvage, moves. Results go to standard output.
#pragma once

#include <string>

#include "common/base/status.h"

namespace tessera {

// `state`: postgresql://... or empty for the SQLite database in the folder `data`.

// Copies the database of a data folder to one file. The coordinator may be running. FAILED_PRECONDITION for PostgreSQL.
Status BackUpData(const std::string& data, const std::string& state, const std::string& to);

// Prints every fault and returns DATA_LOSS if there is one. Quarantines unusable records, as a start would. The state
// must not be in use.
Status VerifyData(const std::string& data, const std::string& state, bool deep);

// Replaces a damaged database by one with its readable records. The folder must not be in use. FAILED_PRECONDITION for
// PostgreSQL.
Status SalvageData(const std::string& data, const std::string& state);

// Copies the whole state, or nothing, to `to`: postgresql://... or the path of a SQLite file. Neither may be in use,
// and `to` must be new or empty. The original stays.
Status CopyStateTo(const std::string& data, const std::string& state, const std::string& to);

}  // namespace tessera
