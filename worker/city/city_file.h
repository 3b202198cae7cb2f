// What ingest hands on: the mesh of the whole city, on disk in blocks that can be read one by one.
#ifndef TESSERA_WORKER_CITY_CITY_FILE_H_
#define TESSERA_WORKER_CITY_CITY_FILE_H_

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

// The mesh after repair and splitting, local frame, wherever it lies; its topology is that of the result.
struct CitySpans {
  MeshSpans mesh;                        // labels: one a face; -1: not labelled
  std::span<const uint32_t> input_face;  // face of the scene's mesh that each face is a part of; empty: its own
  // Global ids, ascending; empty: the indices. Of a city whose mesh changed, some are used no more (revise_city.h).
  std::span<const uint32_t> vertex_ids = {}, face_ids = {};
  int64_t vertex_ids_end = 0, face_ids_end = 0;  // all ids that were ever used are below; of indices: 0
};

// The faces whose centroid lies in a rectangle of cells, as a mesh of its own. Points into a CityReader.
struct CityBlock {
  CellRect cells;
  Eigen::AlignedBox3d box;               // of the vertices, local frame
  MeshSpans mesh;                        // local indices; vertices that other blocks use too are in each of them
  std::span<const uint32_t> vertex_ids;  // global, ascending
  std::span<const uint32_t> face_ids;    // global, ascending
  std::span<const uint32_t> input_face;

  Triangle GlobalFace(size_t face) const {
    const Triangle& f = mesh.faces[face];
    return {vertex_ids[f[0]], vertex_ids[f[1]], vertex_ids[f[2]]};
  }
};

// Rectangles that hold every cell once, each with at most `max_faces` faces unless it is one cell. By halving at the
// borders of cells: a function of the cells alone.
std::vector<CellRect> LayOutBlocks(const std::vector<SurveyCell>& cells, int64_t max_faces);

// The cells that have faces, with all but their views; by y, then x.
std::vector<SurveyCell> CellsOf(const MeshSpans& mesh, const GroundPlane& ground);

constexpr int64_t kCityBlockFaces = 1 << 16;

// `cells`: CellsOf the mesh. Memory is bounded by a block and the number of cells; `scratch_folder` takes up to 20
// bytes a face meanwhile. The file's bytes depend on nothing but the arguments.
Status WriteCity(const std::string& path, const CitySpans& city, const GroundPlane& ground,
                 const std::vector<SurveyCell>& cells, const std::string& scratch_folder,
                 int64_t max_block_faces = kCityBlockFaces);

// A city file in the address space. Const members are thread-safe.
class CityReader {
 public:
  // DATA_LOSS if the file is damaged or its parts do not fit together, as far as that shows without reading the blocks.
  static StatusOr<CityReader> Open(const std::string& path);

  int64_t vertices() const { return vertices_; }
  int64_t faces() const { return faces_; }
  // All ids are below, also those that are used no more.
  int64_t vertex_ids_end() const { return vertex_ids_end_; }
  int64_t face_ids_end() const { return face_ids_end_; }
  size_t block_count() const { return blocks_.size(); }
  const CellRect& cells(size_t block) const { return blocks_[block].cells; }
  const Eigen::AlignedBox3d& box(size_t block) const { return blocks_[block].box; }

  // Reads and checks the block: DATA_LOSS if it is not what was written.
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

// The whole city in memory, without gaps between ids, for tests, benchmarks and small cities.
struct City {
  TriangleMesh mesh;
  std::vector<int64_t> input_face;
};
StatusOr<City> ReadCity(const std::string& path);

}  // namespace tessera

#endif  // TESSERA_WORKER_CITY_CITY_FILE_H_
