// The start mesh as the classifier asks of it: what a ray meets, how it is inclined and how high it stands.
#ifndef TESSERA_COMMON_CLASSIFY_MESH_SURFACE_H_
#define TESSERA_COMMON_CLASSIFY_MESH_SURFACE_H_

#include <Eigen/Core>
#include <array>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/geometry/ray_caster.h"
#include "common/imaging/raster.h"

namespace tessera {

// Holds heights of the mesh seen from above on a grid, at most 4 million cells, beside the rays' tree. Const member
// functions may be called from any thread at once.
class MeshSurface {
 public:
  // Radii of the openings that give the ground below a place: what is narrower stands on it.
  static constexpr std::array<double, 3> kGroundRadii_m = {4, 10, 30};
  // Radii within which the highest and the lowest are compared with a place.
  static constexpr std::array<double, 2> kReliefRadii_m = {1, 3};

  // `up`: unit; `gsd_m`: cells are four of it, or more. The mesh has at least one face; it is not kept.
  MeshSurface(const TriangleMesh& mesh, const Eigen::Vector3d& up, double gsd_m);

  struct Sight {
    bool hit = false;
    float up_normal = 0;  // cosine between the face's normal, turned to the viewer, and up
    std::array<float, kGroundRadii_m.size()> above_ground_m = {};
    std::array<float, kReliefRadii_m.size()> above_lowest_m = {}, below_highest_m = {};
    Eigen::Vector2d place_m;  // horizontal coordinates
  };
  // What a ray meets. `direction` need not be unit.
  Sight See(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const;

  // Horizontal box of the mesh, in the coordinates of Sight::place_m.
  const Eigen::Vector2d& low_m() const { return low_m_; }
  const Eigen::Vector2d& high_m() const { return high_m_; }

 private:
  float At(const FloatImage& plane, const Eigen::Vector2d& place_m) const;

  RayCaster caster_;
  std::vector<Eigen::Vector3f> normals_;  // unit, of faces; zero for those without area
  Eigen::Matrix3d axes_;                  // rows: two horizontal directions, up
  Eigen::Vector2d low_m_, high_m_;
  double cell_m_ = 1;
  std::array<FloatImage, kGroundRadii_m.size()> ground_;
  std::array<FloatImage, kReliefRadii_m.size()> lowest_, highest_;
};

}  // namespace tessera

#endif  // TESSERA_COMMON_CLASSIFY_MESH_SURFACE_H_
