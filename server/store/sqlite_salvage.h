// What can be read of a damaged store.
#ifndef TESSERA_SERVER_STORE_SQLITE_SALVAGE_H_
#define TESSERA_SERVER_STORE_SQLITE_SALVAGE_H_

#include <cstdint>
#include <string>

#include "common/base/status.h"
#include "server/store/record_store.h"

namespace tessera {

struct Salvaged {
  int64_t records = 0;
  int64_t last = 0;     // number of the last record
  std::string damaged;  // where the damaged file lies now
};

// Puts a new database with every record that can be read in place of the one at `path`, which is kept under another
// name. What is missing is told when the store is opened. Nobody may use the database. On error it stays where it was.
StatusOr<Salvaged> Salvage(const std::string& path, const OwnerOf& owner_of);

}  // namespace tessera

#endif  // TESSERA_SERVER_STORE_SQLITE_SALVAGE_H_
