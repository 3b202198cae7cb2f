#include "common/geometry/coarse_mesh.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>
#include <vector>

#include "common/base/random.h"
#include "common/storage/mapped_file.h"

namespace tessera {
namespace {

constexpr size_t kFacesBetweenSorts = size_t{4} << 20;

struct CubeHash {
  size_t operator()(const std::array<int32_t, 3>& c) const {
    return MixBits(MixBits(static_cast<uint64_t>(static_cast<uint32_t>(c[0])) << 32 | static_cast<uint32_t>(c[1])) +
                   static_cast<uint32_t>(c[2]));
  }
};

// Rotates the face so that its lowest index comes first; equal faces then have equal arrays.
Triangle Canonical(const Triangle& face) {
  const auto lowest = std::min_element(face.begin(), face.end()) - face.begin();
  return {face[lowest], face[(lowest + 1) % 3], face[(lowest + 2) % 3]};
}

void RemoveDuplicates(std::vector<Triangle>* faces) {
  std::sort(faces->begin(), faces->end());
  faces->erase(std::unique(faces->begin(), faces->end()), faces->end());
}

}  // namespace

// Clustering needs no adjacency, so the input is read in sequential passes and may exceed memory. Many input faces map
// to the same coarse face; duplicates are removed whenever kFacesBetweenSorts faces were added, which bounds memory by
// the result.
StatusOr<CoarseMesh> CoarsenMesh(const MeshSpans& mesh, int64_t clusters, const std::string& scratch_folder) {
  double area_m2 = 0;
  for (size_t f = 0; f < mesh.faces.size(); ++f) area_m2 += FaceArea(mesh, f);
  const double pitch_m = std::sqrt(std::max(area_m2, 1e-12) / static_cast<double>(std::max<int64_t>(clusters, 1)));
  CoarseMesh coarse;
  coarse.error_m = std::sqrt(3.0) * pitch_m;

  TESSERA_ASSIGN_OR_RETURN(auto cluster_of, ScratchArray<uint32_t>::Create(scratch_folder, mesh.vertices.size()));
  std::unordered_map<std::array<int32_t, 3>, uint32_t, CubeHash> index;
  std::vector<int64_t> members;
  std::vector<Eigen::Vector3d>& means = coarse.mesh.vertices;
  for (size_t v = 0; v < mesh.vertices.size(); ++v) {
    const Eigen::Vector3d cube = (mesh.vertices[v] / pitch_m).array().floor();
    const auto [it, is_new] = index.try_emplace(
        {static_cast<int32_t>(cube.x()), static_cast<int32_t>(cube.y()), static_cast<int32_t>(cube.z())},
        static_cast<uint32_t>(means.size()));
    if (is_new) {
      means.push_back(Eigen::Vector3d::Zero());
      members.push_back(0);
    }
    means[it->second] += mesh.vertices[v];
    ++members[it->second];
    cluster_of[v] = it->second;
  }
  for (size_t c = 0; c < means.size(); ++c) means[c] /= static_cast<double>(members[c]);

  std::vector<Triangle>& faces = coarse.mesh.faces;
  size_t sorted = 0;
  for (const Triangle& face : mesh.faces) {
    const Triangle corners = {cluster_of[face[0]], cluster_of[face[1]], cluster_of[face[2]]};
    if (corners[0] == corners[1] || corners[1] == corners[2] || corners[2] == corners[0]) continue;
    faces.push_back(Canonical(corners));
    if (faces.size() < sorted + kFacesBetweenSorts) continue;
    RemoveDuplicates(&faces);
    sorted = faces.size();
  }
  RemoveDuplicates(&faces);
  return coarse;
}

}  // namespace tessera
