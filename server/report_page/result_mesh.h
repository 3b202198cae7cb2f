// Random access to mesh.ply of a job without reading it into memory.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/storage/mapped_file.h"

namespace tessera {

struct ResultFace {
  Triangle corners = {};
  int32_t label = -1;
  std::optional<std::array<uint8_t, 3>> color_rgb;  // of the label
  std::optional<float> confidence;
  std::optional<int64_t> input_face;
};

// A mesh as PlyStream writes it. Const member functions are thread-safe.
class ResultMesh {
 public:
  // INVALID_ARGUMENT for another file.
  static StatusOr<ResultMesh> Open(const std::string& path);

  size_t vertices() const { return vertices_; }
  size_t faces() const { return faces_; }
  Eigen::Vector3d Vertex(size_t vertex) const;  // the scene's coordinates
  // DATA_LOSS if it has other than three corners, or one that does not exist.
  StatusOr<ResultFace> Face(size_t face) const;

 private:
  static constexpr size_t kNone = SIZE_MAX;
  MappedFile file_;
  size_t vertices_ = 0, faces_ = 0;
  size_t vertices_at_ = 0, faces_at_ = 0;     // bytes from the file's begin
  size_t vertex_bytes_ = 0, face_bytes_ = 0;  // of an element
  std::array<size_t, 3> position_at_ = {};    // bytes from the element's begin
  size_t corners_at_ = 0;                     // of the list's count
  size_t label_at_ = kNone, color_at_ = kNone, confidence_at_ = kNone, input_face_at_ = kNone;
};

}  // namespace tessera
