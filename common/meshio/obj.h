// Reading of Wavefront OBJ files.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/base/status.h"
#include "common/meshio/mesh_content.h"

namespace tessera {

// Whether a file that begins with `head` is OBJ: after comments and empty lines comes a statement of OBJ.
bool IsObj(std::string_view head);

// Always false: OBJ has no labels, only materials.
bool ObjHasLabels(std::string_view head, const std::optional<std::string>& label_property);

// Reads vertices (v) and faces (f, with positive or negative indices, and indices of texture coordinates and normals,
// which are skipped). Faces of more than three vertices are split into fans of triangles. Lines, points and groups are
// skipped, and so are materials (usemtl), unless `options` ask for them. NOT_FOUND if the file does not exist.
// INVALID_ARGUMENT with the line for unknown statements and free-form surfaces, indices without a vertex, faces of
// fewer than 3 or more than 1,000 vertices, NaN, and if `options` name a property of labels. Allocates at most a small
// multiple of the file's size.
StatusOr<MeshContent> ReadObj(const std::string& path, const MeshReadOptions& options = {});

// Reads an OBJ sequentially into `sink`, without holding it in memory. Also returns errors of Begin.
Status StreamObj(const std::string& path, const MeshReadOptions& options, MeshSink* sink);

// Whether the file has more than `max_faces` triangles; reads the file if its size leaves that open.
StatusOr<bool> ObjHasMoreFaces(const std::string& path, int64_t max_faces);

// ReadObj from memory, for fuzzing and tests; `name` is the file's name in messages.
StatusOr<MeshContent> ParseObj(const std::string& bytes, const std::string& name, const MeshReadOptions& options = {});

}  // namespace tessera
