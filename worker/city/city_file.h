// The output of ingest: the mesh of the whole city, stored on disk in blocks that can be read one at a time.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/arrays/mapped_arrays.h"
#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/job/ground.h"
#include "common/job/survey.h"

namespace tessera {

// The mesh after repair and splitting, local frame, in memory or in mapped files. The result has the same topology.
struct CitySpans {
  MeshSpans mesh;                        // labels: one per face; -1: unlabelled
  std::span<const uint32_t> input_face;  // face of the scene's mesh from which each face was split; empty: itself
  // Global ids, ascending; empty: the indices. After changes of the mesh some ids are unused (revise_city.h).
  std::span<const uint32_t> vertex_ids = {}, face_ids = {};
  int64_t vertex_ids_end = 0, face_ids_end = 0;  // one past the largest id ever used; 0 if the ids are the indices
};

// The faces whose centroid lies in a rectangle of cells, as a mesh of its own. Refers to memory of the CityReader.
struct CityBlock {
  CellRect cells;
  Eigen::AlignedBox3d box;               // of the vertices, local frame
  MeshSpans mesh;                        // local indices; vertices shared between blocks are in each of them
  std::span<const uint32_t> vertex_ids;  // global, ascending
  std::span<const uint32_t> face_ids;    // global, ascending
  std::span<const uint32_t> input_face;

  Triangle GlobalFace(size_t face) const {
    const Triangle& f = mesh.faces[face];
    return {vertex_ids[f[0]], vertex_ids[f[1]], vertex_ids[f[2]]};
  }
};

// Partitions the cells into rectangles with at most `max_faces` faces each (single cells may have more), by recursive
// bisection along cell borders. Depends only on the cells.
std::vector<CellRect> LayOutBlocks(const std::vector<SurveyCell>& cells, int64_t max_faces);

// The cells that contain faces, without their views; ordered by y, then x.
std::vector<SurveyCell> CellsOf(const MeshSpans& mesh, const GroundPlane& ground);

constexpr int64_t kCityBlockFaces = 1 << 16;

// Writes a city file. `cells`: CellsOf the mesh. Memory is bounded by one block and the number of cells;
// `scratch_folder` temporarily takes up to 20 bytes per face. The file's bytes depend only on the arguments.
Status WriteCity(const std::string& path, const CitySpans& city, const GroundPlane& ground,
                 const std::vector<SurveyCell>& cells, const std::string& scratch_folder,
                 int64_t max_block_faces = kCityBlockFaces);

// A memory-mapped city file. Const members are thread-safe.
class CityReader {
 public:
  // DATA_LOSS if the file is damaged or inconsistent, as far as can be detected without reading the blocks.
  static StatusOr<CityReader> Open(const std::string& path);

  int64_t vertices() const { return vertices_; }
  int64_t faces() const { return faces_; }
  // One past the largest id ever used, including unused ones.
  int64_t vertex_ids_end() const { return vertex_ids_end_; }
  int64_t face_ids_end() const { return face_ids_end_; }
  size_t block_count() const { return blocks_.size(); }
  const CellRect& cells(size_t block) const { return blocks_[block].cells; }
  const Eigen::AlignedBox3d& box(size_t block) const { return blocks_[block].box; }

  // Reads and verifies a block. DATA_LOSS if its checksum or its indices are wrong.
  StatusOr<CityBlock> Block(size_t block) const;

 private:
  struct Entry {
    CellRect cells;
    Eigen::AlignedBox3d box;
    int64_t vertex_begin = 0, vertex_end = 0, face_begin = 0, face_end = 0;
    uint64_t checksum = 0;
  };
  MappedArrays file_;
  int64_t vertices_ = 0, faces_ = 0, vertex_ids_end_ = 0, face_ids_end_ = 0;
  std::vector<Entry> blocks_;
  std::span<const double> positions_;
  std::span<const uint32_t> vertex_ids_, corners_, face_ids_, input_face_;
  std::span<const int32_t> labels_;
};

}  // namespace tessera
