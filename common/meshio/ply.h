// PLY files: strict reading, atomic writing.
#ifndef TESSERA_COMMON_MESHIO_PLY_H_
#define TESSERA_COMMON_MESHIO_PLY_H_

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/meshio/mesh_content.h"

namespace tessera {

// Whether a file that begins with `head` is PLY.
bool IsPly(std::string_view head);

// Whether the header in `head`, the first bytes of a file, gives faces a property `label`.
bool PlyHasLabels(std::string_view head);

// ASCII or binary of either byte order; float or double; polygons must be triangles; other elements and properties
// (lists too) are read past. Errors are INVALID_ARGUMENT (NOT_FOUND if there is no such file) with line (header, ASCII)
// or byte offset (binary), what was found and what was expected: truncation, trailing bytes, an index out of range, a
// face that is no triangle, NaN. Never allocates more than a small multiple of the file's size.
StatusOr<MeshContent> ReadPly(const std::string& path);

// The same into `sink`, front to back, through a window of the file. Returns the errors of Begin.
Status StreamPly(const std::string& path, MeshSink* sink);

// Faces that the file's header declares. Errors as ReadPly's, of the header.
StatusOr<int64_t> PlyFaceCount(const std::string& path);

// The same from memory; `name` stands for the file in messages. For fuzzing and tests.
StatusOr<MeshContent> ParsePly(const std::string& bytes, const std::string& name);

struct PlyWriteOptions {
  std::vector<std::array<uint8_t, 3>> label_colors_rgb;  // if given, faces get red, green, blue by label (-1: black)
  std::vector<float> face_confidence;                    // if given, faces get `confidence`
  std::vector<int64_t> input_face;                       // if given, faces get int `input_face`
};

// Binary little-endian, double positions, faces with int `label` if the mesh has labels. Written to a temporary name in
// the same folder, synced, renamed.
Status WritePly(const std::string& path, const TriangleMesh& mesh, const PlyWriteOptions& options = {});

// The counts and properties of a file that is written element by element.
struct PlyLayout {
  int64_t vertices = 0, faces = 0;
  bool has_labels = false, has_confidence = false, has_input_face = false, has_outdated = false;
  std::vector<std::array<uint8_t, 3>> label_colors_rgb;  // as in PlyWriteOptions
};

struct PlyFace {
  Triangle vertices;
  int32_t label = -1;
  float confidence = 0;
  int64_t input_face = 0;
  bool outdated = false;  // uchar 0 or 1
};

// Writes the bytes of WritePly front to back without holding the mesh: all vertices, then all faces. The file appears
// under its name only if Finish succeeds. Movable, not thread-safe.
class PlyStream {
 public:
  static StatusOr<PlyStream> Create(const std::string& path, const PlyLayout& layout);
  PlyStream(PlyStream&&) noexcept;
  PlyStream& operator=(PlyStream&&) noexcept;
  ~PlyStream();
  // A fault of the disk is kept for Finish.
  void AddVertex(const Eigen::Vector3d& position);
  void AddFace(const PlyFace& face);
  // INTERNAL if the counts are not those announced.
  Status Finish();

 private:
  struct Impl;
  explicit PlyStream(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera

#endif  // TESSERA_COMMON_MESHIO_PLY_H_
