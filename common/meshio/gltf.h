// Reading of glTF 2.0 files, as JSON (.gltf) or binary (.glb).
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/base/status.h"
#include "common/meshio/mesh_content.h"

namespace tessera {

// Whether a file that begins with `head` is glTF: the signature of GLB, or JSON with a key of glTF.
bool IsGltf(std::string_view head);

// Always false: labels of glTF are read only where they are asked for.
bool GltfHasLabels(std::string_view head, const std::optional<std::string>& label_property);

// Reads the triangles, strips and fans of all meshes of the file's scene, placed by the transforms of their nodes in
// double precision. glTF's y axis points up: (x, y, z) of the file becomes (x, -z, y), z up. Vertices at equal
// positions become one (glTF repeats them at seams of textures and normals); faces that lose a corner by this are left
// out. Points and lines are left out. Warns with the number of each.
//
// Labels: the material of the primitive, if `options` ask for materials; else, if `options` name a property, the vertex
// attribute of this name (such as _FEATURE_ID_0): a face takes the value of most of its vertices.
//
// Buffers lie in the file or in files beside it. NOT_FOUND if the file does not exist. INVALID_ARGUMENT with the byte
// or the JSON path for damaged files, values out of range, and compressed (Draco, meshopt) or sparse data. The JSON
// library is used directly: tinygltf does not check accessors against buffers, copies buffers and loads images.
// Allocates at most a small multiple of the sizes of the files and of the placed primitives.
StatusOr<MeshContent> ReadGltf(const std::string& path, const MeshReadOptions& options = {});

// Reads a glTF file into `sink`. The file is held in memory. Also returns errors of Begin.
Status StreamGltf(const std::string& path, const MeshReadOptions& options, MeshSink* sink);

// Whether the file has more than `max_faces` triangles; reads the file.
StatusOr<bool> GltfHasMoreFaces(const std::string& path, int64_t max_faces);

// ReadGltf from memory, for fuzzing and tests; `name` is the file's name in messages. Other files are not read.
StatusOr<MeshContent> ParseGltf(const std::string& bytes, const std::string& name, const MeshReadOptions& options = {});

}  // namespace tessera
