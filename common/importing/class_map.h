// The file of --classes: which class the faces of a material or label have.
#pragma once

#include <map>
#include <string>

#include "common/base/status.h"

namespace tessera {

// By the name of the material, or the label's number as text: the name of the class, empty for faces without class.
using ClassMap = std::map<std::string, std::string>;

// Reads a JSON object of names: {"Roof_01": "roof", "Walls": "facade", "Trees": null}. null: no class. INVALID_ARGUMENT
// with all faults; NOT_FOUND.
StatusOr<ClassMap> ReadClassMap(const std::string& path);

StatusOr<ClassMap> ParseClassMap(const std::string& text, const std::string& name);

}  // namespace tessera
