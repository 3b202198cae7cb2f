// Meshes larger than memory, on the way from the scene's file to the city.
#ifndef TESSERA_WORKER_CITY_DISK_MESH_H_
#define TESSERA_WORKER_CITY_DISK_MESH_H_

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/geometry/mesh_defects.h"
#include "common/imaging/camera.h"
#include "common/scene/scene.h"
#include "common/storage/mapped_file.h"
#include "worker/refine/density.h"

namespace tessera {

// A mesh in scratch files. Movable.
struct DiskMesh {
  ScratchArray<Eigen::Vector3d> vertices;
  ScratchArray<Triangle> faces;
  ScratchArray<int32_t> labels;       // one a face, or none
  ScratchArray<uint32_t> input_face;  // of the scene's file, one a face; none: each is its own
  bool float_positions = false;       // as they were stored in the scene's file
  double largest_coordinate_m = 0;    // in the scene's frame

  MeshSpans spans() const {
    MeshSpans mesh;
    mesh.vertices = vertices.values();
    mesh.faces = faces.values();
    mesh.labels = labels.values();
    return mesh;
  }
};

// Streams the scene's mesh into scratch files, in the local frame and on its grid. Checks what LoadSceneMesh does, with
// the same errors, but for the rounding of floats.
StatusOr<DiskMesh> ReadMeshToDisk(const SceneDescription& scene, const std::string& scratch_folder);

// Labels as the line needs them, one a face: where the mesh has none, -1 if the scene has likelihoods, else 0.
Status CompleteLabels(bool has_likelihoods, const std::string& scratch_folder, DiskMesh* mesh);

// These faces of a mesh as one of its own, with vertices of their own; labels are left out.
TriangleMesh PickFaces(const MeshSpans& mesh, const std::vector<size_t>& faces);

// How much of a mesh is worked on at a time. Results do not depend on it.
struct DiskPassOptions {
  size_t vertices_per_part = size_t{1} << 19;
  size_t faces_per_chunk = size_t{1} << 18;        // before splitting
  double split_faces_per_chunk = 4.0 * (1 << 20);  // predicted, after it
};

// RepairMesh part by part: the same faces, vertices, order and counts of defects, for any size of parts. What is clean
// is handed on as it is. Memory: a part, and a few numbers a defect.
StatusOr<DiskMesh> RepairOnDisk(DiskMesh mesh, const std::string& scratch_folder, const DiskPassOptions& options,
                                MeshDefects* defects);

// SplitLargeFaces chunk by chunk: the same faces, vertices and order, for any size of chunks.
StatusOr<DiskMesh> SplitOnDisk(DiskMesh mesh, const std::vector<PosedCamera>& cameras, const DensityOptions& density,
                               const std::string& scratch_folder, const DiskPassOptions& options,
                               const std::function<Status(double)>& progress);

}  // namespace tessera

#endif  // TESSERA_WORKER_CITY_DISK_MESH_H_
