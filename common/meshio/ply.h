// Reading and writing of PLY files.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/meshio/mesh_content.h"

namespace tessera {

// Whether a file that begins with `head` is PLY.
bool IsPly(std::string_view head);

// Whether the header in `head`, the first bytes of a file, declares labels. `label_property` as in MeshReadOptions.
bool PlyHasLabels(std::string_view head, const std::optional<std::string>& label_property);

// Reads ASCII or binary PLY of either byte order, with float or double positions. Faces of more than three vertices are
// split into fans of triangles. Labels may have any type of number with whole values. Other elements and properties,
// also lists, are skipped. NOT_FOUND if the file does not exist. INVALID_ARGUMENT with the line (header, ASCII) or byte
// offset (binary) for truncated files, more than a few trailing bytes, indices out of range, faces of fewer than 3 or
// more than 1,000 vertices, NaN. Allocates at most a small multiple of the file's size.
StatusOr<MeshContent> ReadPly(const std::string& path, const MeshReadOptions& options = {});

// Reads a PLY sequentially into `sink`, without holding it in memory. Also returns errors of Begin.
Status StreamPly(const std::string& path, const MeshReadOptions& options, MeshSink* sink);

// Whether the file has more than `max_faces` triangles. Reads the file if its header and size leave that open. Errors
// as in ReadPly, for the part that is read.
StatusOr<bool> PlyHasMoreFaces(const std::string& path, int64_t max_faces);

// ReadPly from memory, for fuzzing and tests; `name` is the file's name in messages.
StatusOr<MeshContent> ParsePly(const std::string& bytes, const std::string& name, const MeshReadOptions& options = {});

struct PlyWriteOptions {
  std::vector<std::array<uint8_t, 3>> label_colors_rgb;  // if given, faces get red, green, blue by label (-1: black)
  std::vector<float> face_confidence;                    // if given, faces get `confidence`
  std::vector<int64_t> input_face;                       // if given, faces get int `input_face`
};

// Writes binary little-endian PLY with double positions, and int `label` per face if the mesh has labels. Atomic:
// writes a temporary file in the same folder, syncs and renames it.
Status WritePly(const std::string& path, const TriangleMesh& mesh, const PlyWriteOptions& options = {});

// The contents of a file that is written element by element.
struct PlyLayout {
  int64_t vertices = 0, faces = 0;
  bool has_labels = false, has_confidence = false, has_input_face = false, has_outdated = false;
  bool has_vertex_colors = false;  // vertices get red, green, blue
  bool has_vertex_labels = false;  // vertices get float `scalar_label`, as CloudCompare and MeshLab read it
  std::vector<std::array<uint8_t, 3>> label_colors_rgb;  // as in PlyWriteOptions
};

struct PlyFace {
  Triangle vertices;
  int32_t label = -1;
  float confidence = 0;
  int64_t input_face = 0;
  bool outdated = false;  // uchar 0 or 1
};

// Writes the same bytes as WritePly sequentially, without holding the mesh: first all vertices, then all faces. The
// file appears at its path only when Finish succeeds. Movable, not thread-safe.
class PlyStream {
 public:
  static StatusOr<PlyStream> Create(const std::string& path, const PlyLayout& layout);
  PlyStream(PlyStream&&) noexcept;
  PlyStream& operator=(PlyStream&&) noexcept;
  ~PlyStream();
  // Finish returns errors of the disk.
  void AddVertex(const Eigen::Vector3d& position, const std::array<uint8_t, 3>& color_rgb = {}, int32_t label = -1);
  void AddFace(const PlyFace& face);
  // INTERNAL if the counts differ from the layout.
  Status Finish();

 private:
  struct Impl;
  explicit PlyStream(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera
