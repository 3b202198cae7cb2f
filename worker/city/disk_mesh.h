// Processes meshes larger than memory, from the scene's file to the city.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/geometry/mesh_defects.h"
#include "common/geometry/repair.h"
#include "common/imaging/camera.h"
#include "common/job/survey.h"
#include "common/scene/scene.h"
#include "common/storage/mapped_file.h"
#include "worker/refine/density.h"

namespace tessera {

// A mesh in scratch files. Movable.
struct DiskMesh {
  ScratchArray<Eigen::Vector3d> vertices;
  ScratchArray<Triangle> faces;
  ScratchArray<Eigen::Vector3d> starts;  // one per vertex: where it was before it moved; or empty
  ScratchArray<int32_t> labels;          // one per face, or empty
  ScratchArray<uint32_t> input_face;     // face of the scene's file, one per face; empty: itself
  bool float_positions = false;       // the scene's file stores floats
  double largest_coordinate_m = 0;    // in the scene's frame

  MeshSpans spans() const { return {vertices.values(), faces.values(), labels.values()}; }
};

// Streams the scene's mesh into scratch files, in the local frame and rounded to the local grid. Checks, errors and
// warnings as LoadSceneMesh, except that float positions are not tested for rounding.
StatusOr<DiskMesh> ReadMeshToDisk(const SceneDescription& scene, const std::string& scratch_folder,
                                  Warnings* warnings = nullptr);

// Ensures one label per face. A mesh without labels gets -1 if the scene has likelihoods, else 0.
Status CompleteLabels(bool has_likelihoods, const std::string& scratch_folder, DiskMesh* mesh);

// Extracts these faces with their vertices as a mesh, without labels.
TriangleMesh PickFaces(const MeshSpans& mesh, const std::vector<size_t>& faces);

// Size of the parts processed at a time. Results do not depend on it.
struct DiskPassOptions {
  size_t vertices_per_part = size_t{1} << 19;
  size_t faces_per_chunk = size_t{1} << 18;        // before splitting
  double split_faces_per_chunk = 4.0 * (1 << 20);  // predicted, after splitting
};

// RepairMesh on disk: same faces, vertices, order and defect counts, for any part size. A mesh without defects is
// returned unchanged. Memory: one part, and a few numbers per defect, open edge and piece; the rays to at most 4 million
// faces.
StatusOr<DiskMesh> RepairOnDisk(DiskMesh mesh, const std::string& scratch_folder, const DiskPassOptions& options,
                                const RepairOptions& repair, MeshDefects* defects);

// SplitLargeFaces on disk: same faces, vertices and order, for any chunk size. A new vertex starts half-way between the
// starts of the ends of its edge.
StatusOr<DiskMesh> SplitOnDisk(DiskMesh mesh, const std::vector<PosedCamera>& cameras, const DensityOptions& density,
                               const std::string& scratch_folder, const DiskPassOptions& options,
                               const std::function<Status(double)>& progress);

// Sets SurveyCell::fine_faces to the number of faces that SplitLargeFaces makes of the cell's faces. `cells`: CellsOf
// the mesh.
void CountSplitFaces(const MeshSpans& mesh, const std::vector<PosedCamera>& cameras, const DensityOptions& density,
                     const DiskPassOptions& options, const GroundPlane& ground, std::vector<SurveyCell>* cells);

}  // namespace tessera
