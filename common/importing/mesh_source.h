// The files of a mesh that another program exported: one file, or a folder of tiles.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

struct MeshSource {
  std::vector<std::string> files;       // absolute paths, one a tile, in the order of tile_names
  std::vector<std::string> tile_names;  // sorted; the file's name without ending, with its folders where names repeat
  std::vector<std::string> metadata;    // files beside the mesh that were read, absolute
  // The coordinate reference system that the program named, as in ImportedBlock::crs; empty: none.
  std::string crs;
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();  // file coordinates + offset = coordinates of the system
  std::vector<std::string> conventions, left_out;    // as in ImportedBlock
};

// Finds the mesh at `path`: an OBJ, PLY, GLB or glTF file, or a folder that has such files at any depth, such as
// ContextCapture's Data/Tile_+001_-002/Tile_+001_-002.obj. Of a tile with levels of detail (..._L21_3.obj) only the
// finest are taken. Reads the system and the offset from metadata.xml of ContextCapture (SRS, SRSOrigin) in the folder
// of the mesh or up to two above, or for odm_textured_model_geo.obj from OpenDroneMap's
// odm_georeferencing_model_geo.txt. Opens no mesh. NOT_FOUND; INVALID_ARGUMENT with all faults.
StatusOr<MeshSource> FindMeshSource(const std::string& path);

struct ModelMetadata {
  std::string crs;                                   // SRS; empty if there is none
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  // SRSOrigin
};

// Parses a metadata.xml; `name` is the file's name in messages.
StatusOr<ModelMetadata> ParseModelMetadata(const std::string& bytes, const std::string& name);

}  // namespace tessera
