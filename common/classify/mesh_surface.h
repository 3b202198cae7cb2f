// Ray queries on the start mesh for classification: slope and relative height of the hit surface.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/geometry/ray_caster.h"
#include "common/imaging/raster.h"

namespace tessera {

// A ray caster and height grids of the mesh seen from above (at most 4 million cells). Const member functions are
// thread-safe.
class MeshSurface {
 public:
  // Radii of the morphological openings that estimate the ground height; objects narrower than a radius are removed.
  static constexpr std::array<double, 3> kGroundRadii_m = {4, 10, 30};
  // Radii of the neighbourhoods for the lowest and highest surface.
  static constexpr std::array<double, 2> kReliefRadii_m = {1, 3};

  // `up`: unit vector. `gsd_m`: the cell size is at least 4 GSD. The mesh has at least one face; it is not retained.
  MeshSurface(const TriangleMesh& mesh, const Eigen::Vector3d& up, double gsd_m);

  struct SurfaceHit {
    bool hit = false;
    float up_normal = 0;  // cosine between up and the face's normal (oriented towards the viewer)
    std::array<float, kGroundRadii_m.size()> above_ground_m = {};
    std::array<float, kReliefRadii_m.size()> above_lowest_m = {}, below_highest_m = {};
    Eigen::Vector2d position_m;  // horizontal coordinates of the hit
  };
  // The first hit of a ray. `direction` need not be a unit vector.
  SurfaceHit Cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const;

  // Horizontal bounding box of the mesh, in the coordinates of SurfaceHit::position_m.
  const Eigen::Vector2d& low_m() const { return low_m_; }
  const Eigen::Vector2d& high_m() const { return high_m_; }

 private:
  float At(const FloatImage& plane, const Eigen::Vector2d& position_m) const;

  RayCaster caster_;
  std::vector<Eigen::Vector3f> normals_;  // unit face normals; zero for degenerate faces
  Eigen::Matrix3d axes_;                  // rows: two horizontal directions, up
  Eigen::Vector2d low_m_, high_m_;
  double cell_m_ = 1;
  std::array<FloatImage, kGroundRadii_m.size()> ground_;
  std::array<FloatImage, kReliefRadii_m.size()> lowest_, highest_;
};

}  // namespace tessera
