// BlocksExchange, the XML of ContextCapture and iTwin Capture (also called CC Orientations), versions 2.1 to 3.2.
#pragma once

#include <functional>
#include <string>

#include "common/blocks/block_format.h"

namespace tessera {

// Whether `path` is a BlocksExchange file: XML (.xml), or a zip archive with it (.xmz, .xmlz).
bool IsBlocksExchange(const std::string& path);

// Reads it, and the file of tie points that it names. As BlockFormat::read.
ImportedBlock ReadBlocksExchange(const std::string& path, const BlockReadOptions& options, Faults* faults,
                                 Warnings* warnings);

// The same from memory, for fuzzing and tests. `text`: the XML. `load`: the content of the file of tie points at a path
// as the XML has it.
using ExchangeLoader = std::function<StatusOr<std::string>(const std::string& path)>;
ImportedBlock ParseBlocksExchange(std::string text, const std::string& name, const ExchangeLoader& load,
                                  const BlockReadOptions& options, Faults* faults, Warnings* warnings);

}  // namespace tessera
