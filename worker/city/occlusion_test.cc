#include "worker/city/occlusion_test.h"

#include <vector>

namespace tessera {

StatusOr<TriangleMesh> FacesAround(const CityReader& city, const Eigen::AlignedBox3d& box, double radius_m) {
  const Eigen::Vector3d margin = Eigen::Vector3d::Constant(radius_m);
  const Eigen::AlignedBox3d around(box.min() - margin, box.max() + margin);
  TriangleMesh found;
  for (size_t b = 0; b < city.block_count(); ++b) {
    if (!city.box(b).intersects(around)) continue;
    TESSERA_ASSIGN_OR_RETURN(const CityBlock block, city.Block(b));
    constexpr uint32_t kNone = UINT32_MAX;
    std::vector<uint32_t> index(block.vertex_ids.size(), kNone);
    for (size_t f = 0; f < block.face_ids.size(); ++f) {
      Eigen::AlignedBox3d face_box;
      for (int k = 0; k < 3; ++k) face_box.extend(block.mesh.Corner(f, k));
      if (!face_box.intersects(around)) continue;
      Triangle& face = found.faces.emplace_back();
      for (int k = 0; k < 3; ++k) {
        uint32_t& at = index[block.mesh.faces[f][k]];
        if (at == kNone) {
          at = static_cast<uint32_t>(found.vertices.size());
          found.vertices.push_back(block.mesh.Corner(f, k));
        }
        face[k] = at;
      }
    }
  }
  return found;
}

}  // namespace tessera
