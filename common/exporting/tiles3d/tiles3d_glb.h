// The content of a tile: a mesh as binary glTF.
#pragma once

#include <string>
#include <vector>

#include "common/exporting/tiles3d/tiles3d_mesh.h"
#include "common/scene/scene.h"

namespace tessera {

// The class of ASPRS LAS 1.4 for a class of this name; 1 (unclassified) if none is known.
uint8_t AsprsClassOf(const std::string& class_name);

// A GLB file (glTF 2.0) of the faces, which are at least one. y is up: (x, y, z) becomes (x, z, -y). A node has a
// translation of whole metres, and floats relative to it, which are exact; a mesh that is too wide for that has several
// nodes. Vertices have a normal, a colour, `_CONFIDENCE` and `_DISPLACEMENT` where they are known, and the feature id
// 0, a row of the table of classes (EXT_mesh_features, EXT_structural_metadata): name, color (sRGB), asprs. The last
// row, "unlabelled", is of labels that are no class. With `photographic` colours, which contain light and shadow, the
// material is unlit and there are no normals.
std::string MakeTiles3dGlb(const Tiles3dVertices& vertices, const Tiles3dFaces& faces,
                           const std::vector<SceneClass>& classes, bool photographic);

}  // namespace tessera
