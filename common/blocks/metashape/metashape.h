// PhotoScan and Metashape: the XML of "Export cameras" (1.2 to 2.x), and projects (.psz, .psx).
#pragma once

#include <string>

#include "common/blocks/block_format.h"

namespace tessera {

// Whether `path` is an XML of cameras, a project (.psz or .psx), or the folder NAME.files of a .psx.
bool IsMetashape(const std::string& path);

// As BlockFormat::read. Of several chunks, reads the one with most oriented cameras. Projects have tie points.
ImportedBlock ReadMetashape(const std::string& path, const BlockReadOptions& options, Faults* faults,
                            Warnings* warnings);

// The same of an XML or a .psz in memory, for fuzzing and tests.
ImportedBlock ParseMetashape(std::string bytes, const std::string& name, const BlockReadOptions& options,
                             Faults* faults, Warnings* warnings);

}  // namespace tessera
