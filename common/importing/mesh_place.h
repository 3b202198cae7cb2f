// Where the vertices of a mesh lie in the scene of a block.
#pragma once

#include <string>

#include "common/base/status.h"
#include "common/importing/frames.h"
#include "common/importing/mesh_tiles.h"

namespace tessera {

struct MeshPlace {
  SceneMap map;                   // from the coordinates of the mesh's files + MeshSource::offset to those of the scene
  SourceCoordinates coordinates;  // the same, as it was chosen
  std::string text;               // how they were read, for import.json
  std::string label_property;     // of the labels in the first file; empty: it has none
};

// Reads the mesh's coordinates in `crs`, else in the system that its files name, else in that of the block. In the
// block's system, a mesh whose files state no offset may have the block's offset or none: the reading that brings the
// first file nearer to the block is taken. `source`: the block as it was read; `placed`: in scene coordinates.
StatusOr<MeshPlace> PlaceMesh(const MeshSource& mesh, const std::string& crs, const ImportedBlock& source,
                              const std::string& source_crs, const PlacedBlock& placed, const HeightOptions& heights);

// The mesh that belongs to a source, such as the textured model of an OpenDroneMap project; empty if there is none.
std::string MeshOfSource(const std::string& source);

}  // namespace tessera
