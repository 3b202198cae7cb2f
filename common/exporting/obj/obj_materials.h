// Classes as materials of OBJ files.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "common/scene/scene.h"

namespace tessera {

// The file beside each OBJ.
inline constexpr char kObjMaterialFile[] = "classes.mtl";

// Names of materials for the classes, in their order, and last that of faces without a class ("unclassified"). Names of
// materials end at a blank, so characters other than ASCII letters, digits, '.', '-' and '_', and those beyond ASCII,
// become '_'. Names that would be equal get a number.
std::vector<std::string> ObjMaterialNames(std::span<const SceneClass> classes);

// The content of kObjMaterialFile: the colours of the classes.
std::string ObjMaterials(std::span<const SceneClass> classes);

// The content of a file for `tessera import --classes`, by which materials become the classes again.
std::string ObjClassMap(std::span<const SceneClass> classes);

}  // namespace tessera
