// Mesh files of any format: a table of readers, one row a format. To add a format, write a file with its reader and add
// a row to kFormats in mesh_format.cc.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/base/status.h"
#include "common/meshio/mesh_content.h"

namespace tessera {

struct MeshFormat {
  std::string_view name;                   // for messages
  bool (*matches)(std::string_view head);  // whether a file that begins with `head` has this format
  // Whether a file that begins with `head` has labels.
  bool (*has_labels)(std::string_view head, const std::optional<std::string>& label_property);
  StatusOr<MeshContent> (*read)(const std::string& path, const MeshReadOptions& options);
  Status (*stream)(const std::string& path, const MeshReadOptions& options, MeshSink* sink);
  StatusOr<bool> (*has_more_faces)(const std::string& path, int64_t max_faces);
};

// Reads a mesh file; the format is detected from its first bytes. INVALID_ARGUMENT if no format matches, with what the
// file is instead where its bytes show it (foreign_content.h). NOT_FOUND if the file does not exist. Else errors of the
// format's reader (ReadPly, ReadObj).
StatusOr<MeshContent> ReadMesh(const std::string& path, const MeshReadOptions& options = {});

// Whether a file that begins with `head` has labels, of faces or vertices. False if no format matches.
bool HeadHasLabels(std::string_view head, const std::optional<std::string>& label_property = {});

// Reads the file sequentially into `sink`, without holding it in memory. Also returns errors of Begin.
Status StreamMesh(const std::string& path, const MeshReadOptions& options, MeshSink* sink);

// Whether the file has more than `max_faces` triangles. May read the whole file, without holding it in memory.
StatusOr<bool> HasMoreFaces(const std::string& path, int64_t max_faces);

}  // namespace tessera
