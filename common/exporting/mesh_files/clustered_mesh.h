// Simplification of a city of any size by vertex clustering.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "common/exporting/sheet.h"
#include "common/geometry/position_index.h"

namespace tessera {

// Merges all vertices in a cube of a grid into one, at the point with the least sum of squared distances from the
// planes of their faces (Lindstrom, Out-of-core simplification of large polygonal models, SIGGRAPH 2000). The grid is
// the same for all sheets, so that no cracks open between them, and memory depends on the result only. Not thread-safe.
class ClusteredMesh {
 public:
  explicit ClusteredMesh(double cell_m) : cell_m_(cell_m) {}

  void Add(const Sheet& sheet);
  // The simplified mesh: labels of the first of the faces that became one, mean colours if the sheets have colours.
  // Faces are ordered by their vertices. The object is empty afterwards.
  Sheet Take();

 private:
  struct Cluster {
    // Sums over the corners of faces, for normals n of length twice the area and corners p relative to the centre of
    // the cube: n n^T (its upper triangle) and (n . p) n. The point x solves matrix x = vector.
    Eigen::Matrix<double, 6, 1> matrix = Eigen::Matrix<double, 6, 1>::Zero();
    Eigen::Vector3d vector = Eigen::Vector3d::Zero();
    Eigen::Vector3d position_sum = Eigen::Vector3d::Zero();  // relative to the centre
    std::array<uint64_t, 3> color_sum = {};
    uint32_t corners = 0;
  };
  struct ClusterFace {
    Triangle corners;
    int32_t label;
  };
  Eigen::Vector3d CentreOf(uint32_t cluster) const;
  Eigen::Vector3d PositionOf(uint32_t cluster) const;

  double cell_m_;
  bool colored_ = true;
  PositionIndex cells_;  // cell coordinates
  std::vector<Cluster> clusters_;
  std::vector<ClusterFace> faces_;
};

}  // namespace tessera
