// BlocksExchange, which is its own file of tie points too.
#pragma once

#include <string>

#include "common/blocks/blocks_exchange/blocks_exchange.h"
#include "tests/fuzz/blocks/block_promises.h"

namespace tessera {

// True if it was taken as a block.
inline bool RunBlocksExchangeTarget(const std::string& bytes) {
  Faults faults;
  Warnings warnings;
  const auto load = [&](const std::string&) -> StatusOr<std::string> { return bytes; };
  const ImportedBlock block = ParseBlocksExchange(bytes, "input", load, {}, &faults, &warnings);
  if (!Accepted(faults)) return false;
  RequireBlock(block);
  return true;
}

}  // namespace tessera
