// E_inter: Σ (π - γ)² along label borders, which straightens them (Bláha et al. 2017, section 3.1, with the
// derivative at all three vertices of a corner).
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "common/geometry/csr_rows.h"
#include "common/geometry/mesh.h"

namespace tessera {

// Which corners involve which vertices; ascending by vertex.
struct CornerIncidence {
  std::vector<uint32_t> vertices;
  std::vector<uint32_t> begin;    // entries of vertices[i]: entries[begin[i] .. begin[i + 1])
  std::vector<uint32_t> entries;  // 3·corner + role; role 0: v, 1: v1, 2: v2
};

// Positive semidefinite approximation of the second derivative: the sum of ‖Residual‖² · weight / 2 over corners.
struct InterCurvature {
  struct Corner {
    std::array<uint32_t, 3> vertex;  // v, v1, v2
    Eigen::Vector3f a, b;            // unit vectors from v to v1 and v2
    float inverse_a = 0, inverse_b = 0;
    float weight = 0;

    // Change of â + b̂ if v, v1, v2 move by x0, x1, x2.
    Eigen::Vector3f Residual(const Eigen::Vector3f& x0, const Eigen::Vector3f& x1, const Eigen::Vector3f& x2) const {
      return inverse_a * Across(a, x1 - x0) + inverse_b * Across(b, x2 - x0);
    }
    // The row of `role` of the transposed operator, times r.
    Eigen::Vector3f Transposed(uint32_t role, const Eigen::Vector3f& r) const {
      if (role == 1) return inverse_a * Across(a, r);
      if (role == 2) return inverse_b * Across(b, r);
      return -inverse_a * Across(a, r) - inverse_b * Across(b, r);
    }
    // Diagonal block of `role`, including the weight.
    Eigen::Matrix3f Block(uint32_t role) const;

    static Eigen::Vector3f Across(const Eigen::Vector3f& unit, const Eigen::Vector3f& x) {
      return x - unit.dot(x) * unit;
    }
  };
  std::vector<Corner> corners;
  CornerIncidence incidence;
};

// Corners of the term: vertices inside the mesh whose faces have exactly two labels, each in one connected fan; γ is
// the angle between the two border edges there. Corners that no image pair observes are ignored (`pairs` below),
// since no data would resist a border that the labels put in the wrong place.
// The energy is dimensionless: it does not change if the scene is scaled. Its weight is therefore relative to the
// photo energy (per vertex: 1 - ZNCC summed over the surrounding pixels of the level), while those of SmoothTerm are
// per metre². A border edge of length s that turns by δ exerts the force 2 δ/s.
// Const members are thread-safe; results do not depend on the number of threads.
class InterTerm {
 public:
  using Positions = std::vector<Eigen::Vector3d>;

  // `fixed`: flags of boundary and frozen vertices, one per vertex or empty. Their derivative is zero, but they take
  // part in the corners of their neighbours. No corners until SetLabels.
  InterTerm(const TriangleMesh& mesh, const std::vector<uint8_t>& fixed);

  // One label per face, or empty: no corners. Faces of label -1 or 255 (unlabelled) have no border.
  void SetLabels(const std::vector<int32_t>& labels);

  // `pairs`: number of image pairs that observe each vertex (PhotoDerivatives). A corner without pairs has no energy.
  // Empty: all corners count.
  double Energy(const Positions& v, const std::vector<float>& pairs = {}) const;
  // Dependency radius of a derivative in rings: a corner next to the vertex, that corner's ends and their faces.
  static constexpr int kGradientRings = 2;
  // Adds weight · dE/dv.
  void AddGradient(const Positions& v, double weight, const std::vector<float>& pairs, Positions* gradient) const;

  // Gauss-Newton form in J = d(â + b̂), weighted such that it bounds the second derivative on the unit sphere. As a
  // function of two directions at angle δ from straight, δ² has second derivatives of at most 4 (bending) and 0
  // (rotating both), while JᵀJ has 1 + cos δ in the plane of the corner. Near γ = 0, where the bound fails, the
  // weight is limited.
  InterCurvature Curvature(const Positions& v, double weight, const std::vector<float>& pairs = {}) const;

  // v, v1 < v2; ascending by v.
  const std::vector<std::array<uint32_t, 3>>& corners() const { return corners_; }

 private:
  std::vector<Triangle> faces_;
  std::vector<uint8_t> fixed_;
  CsrRows faces_of_vertex_;
  bool Counts(size_t corner, const std::vector<float>& pairs) const {
    return pairs.empty() || pairs[corners_[corner][0]] > 0;
  }

  std::vector<std::array<uint32_t, 3>> corners_;
  CornerIncidence incidence_;
};

}  // namespace tessera
