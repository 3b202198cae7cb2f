// The token file.
#pragma once

#include <string>

#include "common/access/tokens.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// True if it was taken.
inline bool RunTokensTarget(const std::string& bytes) {
  const StatusOr<TokenTable> table = TokenTable::Parse(bytes, "input");
  if (!table.ok()) {
    RequireRefusal(table.status());
    return false;
  }
  const StatusOr<TokenTable> again = TokenTable::Parse(table->ToText(), "input");
  Require(again.ok() && again->ToText() == table->ToText(), "what is written is read as it was");
  for (const TokenEntry& entry : table->entries()) {
    Require(!entry.name.empty() && entry.sha256.size() == 64, "a token has a name and a hash");
    Require(table->Find(entry.sha256) == nullptr, "the hash of a token is none");
  }
  return true;
}

}  // namespace tessera
