// Mesh files of any format: a table of readers, one row a format. To add a format, write a file with its reader and add
// a row to kFormats in mesh_format.cc.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "common/base/status.h"
#include "common/meshio/mesh_content.h"

namespace tessera {

struct MeshFormat {
  std::string_view name;                      // for messages
  bool (*matches)(std::string_view head);     // whether a file that begins with `head` has this format
  bool (*has_labels)(std::string_view head);  // whether faces have labels, as far as `head` tells
  StatusOr<MeshContent> (*read)(const std::string& path);
  Status (*stream)(const std::string& path, MeshSink* sink);
  StatusOr<int64_t> (*count_faces)(const std::string& path);
};

// Reads a mesh file; the format is detected from its first bytes. INVALID_ARGUMENT if no format matches, NOT_FOUND if
// the file does not exist, else errors of the format's reader (ReadPly).
StatusOr<MeshContent> ReadMesh(const std::string& path);

// Whether the faces of a file that begins with `head` have labels. False if no format matches.
bool HeadHasLabels(std::string_view head);

// Reads the file sequentially into `sink`, without holding it in memory. Also returns errors of Begin.
Status StreamMesh(const std::string& path, MeshSink* sink);

// The number of faces that the file declares.
StatusOr<int64_t> CountMeshFaces(const std::string& path);

}  // namespace tessera
