// E_inter: Σ (π - γ)² along label borders, which straightens them (Bláha et al. 2017, section 3.1, with the derivative
// at all three vertices).
#ifndef TESSERA_WORKER_REFINE_INTER_TERM_H_
#define TESSERA_WORKER_REFINE_INTER_TERM_H_

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "common/geometry/mesh.h"

namespace tessera {

// What a border's corners have in common with the vertices they touch, by rising vertex.
struct CornerIncidence {
  std::vector<uint32_t> vertices;
  std::vector<uint32_t> begin;    // entries of vertices[i]: entries[begin[i] .. begin[i + 1])
  std::vector<uint32_t> entries;  // 3·corner + role; role 0: v, 1: v1, 2: v2
};

// A positive semidefinite stand-in for the second derivative: the sum of ‖Residual‖² · weight / 2 over corners.
struct InterCurvature {
  struct Corner {
    std::array<uint32_t, 3> vertex;  // v, v1, v2
    Eigen::Vector3f a, b;            // unit vectors from v to v1 and v2
    float inverse_a = 0, inverse_b = 0;
    float weight = 0;

    // Change of â + b̂ when v, v1, v2 move by x0, x1, x2.
    Eigen::Vector3f Residual(const Eigen::Vector3f& x0, const Eigen::Vector3f& x1, const Eigen::Vector3f& x2) const {
      return inverse_a * Across(a, x1 - x0) + inverse_b * Across(b, x2 - x0);
    }
    // The transposed operator's row of `role`, times r.
    Eigen::Vector3f Transposed(uint32_t role, const Eigen::Vector3f& r) const {
      if (role == 1) return inverse_a * Across(a, r);
      if (role == 2) return inverse_b * Across(b, r);
      return -inverse_a * Across(a, r) - inverse_b * Across(b, r);
    }
    // Diagonal block of `role`, weight included.
    Eigen::Matrix3f Block(uint32_t role) const;

    static Eigen::Vector3f Across(const Eigen::Vector3f& unit, const Eigen::Vector3f& x) {
      return x - unit.dot(x) * unit;
    }
  };
  std::vector<Corner> corners;
  CornerIncidence incidence;
};

// Corners: vertices off the rim whose faces have exactly two labels, each in one connected fan; γ is the angle between
// the two border edges there. Those that no pair of images compares do not count (`pairs` below): nothing there would
// hold against a border that the labels have in the wrong place. Dimensionless: the energy does not change when the
// scene is scaled. So its weight counts against the photo energy itself (per vertex: 1 - ZNCC summed over the pixels of
// the level about it), while those of SmoothTerm are per metre²; a border edge of length s that turns by δ pulls with 2
// δ/s. Const members may be called from any thread; results do not depend on the number of threads.
class InterTerm {
 public:
  using Positions = std::vector<Eigen::Vector3d>;

  // `fixed`: flags of boundary and frozen vertices, one a vertex or empty; their derivative is zero, but their
  // neighbours straighten against them. No corners until SetLabels.
  InterTerm(const TriangleMesh& mesh, const std::vector<uint8_t>& fixed);

  // One label a face, or empty: no corners. Faces of label -1 or 255 (unlabelled) have no border.
  void SetLabels(const std::vector<int32_t>& labels);

  // `pairs`: how many pairs of images compare at each vertex (PhotoDerivatives); a corner where none does has no
  // energy, for no image would hold against it. Empty: all have.
  double Energy(const Positions& v, const std::vector<float>& pairs = {}) const;
  // Of vertices, that a derivative depends on: a corner beside the vertex, and that corner's ends and faces.
  static constexpr int kGradientRings = 2;
  // Adds weight · dE/dv.
  void AddGradient(const Positions& v, double weight, const std::vector<float>& pairs, Positions* gradient) const;

  // Gauss-Newton's form in J = d(â + b̂), weighted so that it bounds the second derivative on the unit sphere: as
  // function of two directions at angle δ from straight, that of δ² has eigenvalues of at most 4 (bending) and 0
  // (turning both), while JᵀJ has 1 + cos δ in the plane of the corner. Bounded at γ = 0, where it falls short.
  InterCurvature Curvature(const Positions& v, double weight, const std::vector<float>& pairs = {}) const;

  // v, v1 < v2, by rising v.
  const std::vector<std::array<uint32_t, 3>>& corners() const { return corners_; }

 private:
  std::vector<Triangle> faces_;
  std::vector<uint8_t> fixed_;
  std::vector<uint32_t> faces_begin_, faces_at_;  // faces of v: faces_at_[faces_begin_[v] .. faces_begin_[v + 1])
  bool Counts(size_t corner, const std::vector<float>& pairs) const {
    return pairs.empty() || pairs[corners_[corner][0]] > 0;
  }

  std::vector<std::array<uint32_t, 3>> corners_;
  CornerIncidence incidence_;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_INTER_TERM_H_
