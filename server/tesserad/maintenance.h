// What `tesserad` does with a data folder instead of serving it. Results go to standard output.
#ifndef TESSERA_SERVER_TESSERAD_MAINTENANCE_H_
#define TESSERA_SERVER_TESSERAD_MAINTENANCE_H_

#include <string>

#include "common/base/status.h"

namespace tessera {

// The database of a data folder, whose coordinator may run, as one file.
Status BackUpData(const std::string& data, const std::string& to);

// DATA_LOSS if anything is wrong; what, is printed, and set aside where a start would do so. Nobody may use the folder.
Status VerifyData(const std::string& data, bool deep);

// Puts what can be read of a damaged database in its place. Nobody may use the folder.
Status SalvageData(const std::string& data);

}  // namespace tessera

#endif  // TESSERA_SERVER_TESSERAD_MAINTENANCE_H_
