// SmoothTerm::SolveStep: two passes over the vertices a sweep, in single precision.
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>

#include "common/base/parallel.h"
#include "worker/refine/inter_term.h"
#include "worker/refine/smooth_term.h"

namespace tessera {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Eigen::Vector3f;
using Eigen::Vector4f;

constexpr int64_t kGrain = 4096;
// Eigenvalues of the preconditioned matrix: the preconditioner holds them below `kHigh`, and the low end only sets
// which smooth modes are left to the next call.
constexpr double kHigh = 3.5, kLow = 0.08;

// A symmetric 3x3 block.
struct SymmetricBlock {
  float xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;

  explicit SymmetricBlock(const Matrix3d& m)
      : xx(static_cast<float>(m(0, 0))),
        xy(static_cast<float>(m(0, 1))),
        xz(static_cast<float>(m(0, 2))),
        yy(static_cast<float>(m(1, 1))),
        yz(static_cast<float>(m(1, 2))),
        zz(static_cast<float>(m(2, 2))) {}
  SymmetricBlock() = default;

  Vector4f Times(const Vector4f& v) const {
    return v[0] * Vector4f(xx, xy, xz, 0) + v[1] * Vector4f(xy, yy, yz, 0) + v[2] * Vector4f(xz, yz, zz, 0);
  }
};

// Bits of x with two zeros between each.
uint64_t Spread(uint64_t x) {
  x &= 0x1fffff;
  x = (x | x << 32) & 0x1f00000000ffffull;
  x = (x | x << 16) & 0x1f0000ff0000ffull;
  x = (x | x << 8) & 0x100f00f00f00f00full;
  x = (x | x << 4) & 0x10c30c30c30c30c3ull;
  x = (x | x << 2) & 0x1249249249249249ull;
  return x;
}

// Vertices along a Morton curve through `positions`.
std::vector<uint32_t> MortonOrder(const std::vector<Vector3d>& positions) {
  std::vector<std::pair<uint64_t, uint32_t>> keyed(positions.size());
  Vector3d low = Vector3d::Zero(), high = Vector3d::Zero();
  if (!positions.empty()) low = high = positions[0];
  for (const Vector3d& p : positions) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const double scale = 2097151.0 / std::max((high - low).maxCoeff(), 1e-30);
  for (size_t v = 0; v < positions.size(); ++v) {
    const Vector3d cell = (positions[v] - low) * scale;
    const uint64_t key = Spread(static_cast<uint64_t>(cell.x())) | Spread(static_cast<uint64_t>(cell.y())) << 1 |
                         Spread(static_cast<uint64_t>(cell.z())) << 2;
    keyed[v] = {key, static_cast<uint32_t>(v)};
  }
  std::sort(keyed.begin(), keyed.end());
  std::vector<uint32_t> order(positions.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = keyed[i].second;
  return order;
}

}  // namespace

// "Places" count vertices in memory order. Rings keep the order of vertex numbers, so that the order of places
// changes no sum.
struct SmoothTerm::Layout {
  std::vector<uint32_t> vertex_at;  // of a place
  std::vector<uint32_t> place_of;   // of a vertex
  std::vector<uint32_t> ring_begin, ring;
};

void SmoothTerm::MakeLayout() {
  auto layout = std::make_shared<Layout>();
  layout->vertex_at = MortonOrder(start_);
  layout->place_of.resize(start_.size());
  for (size_t p = 0; p < start_.size(); ++p) layout->place_of[layout->vertex_at[p]] = static_cast<uint32_t>(p);
  layout->ring_begin.push_back(0);
  layout->ring.reserve(rings_.to.size());
  for (uint32_t v : layout->vertex_at) {
    for (uint32_t e = rings_.begin[v]; e < rings_.begin[v + 1]; ++e) {
      layout->ring.push_back(layout->place_of[rings_.to[e]]);
    }
    layout->ring_begin.push_back(static_cast<uint32_t>(layout->ring.size()));
  }
  layout_ = std::move(layout);
}

// The system of one call, by places.
class SmoothTerm::System {
 public:
  System(const SmoothTerm& term, const std::vector<Matrix3d>& data, const Positions& rhs, const SmoothWeights& weights,
         const InterCurvature* inter)
      : term_(term), layout_(*term.layout_), weights_(weights), inter_(inter), projected_(weights.tangential != 1) {
    const size_t n = rhs.size();
    factors_.resize(n);
    rhs_.resize(n);
    data_.resize(n);
    inverse_.resize(n);
    rows_.resize(n);
    direction_.assign(n, Vector4f::Zero());
    step_.assign(n, Vector4f::Zero());
    if (projected_) {
      normals_.resize(n);
      raw_rows_.assign(n, Vector4f::Zero());
    }
    FindSpecialPlaces();
    ForPlaces([&](size_t p) { SetUp(p, data, rhs); });
  }

  void Sweep(float keep, float gain) {
    MakeRows();
    Update(keep, gain);
  }

  void TakeStep(Positions* step) const {
    step->resize(step_.size());
    ForPlaces([&](size_t p) { (*step)[layout_.vertex_at[p]] = step_[p].head<3>().cast<double>(); });
  }

 private:
  struct Factors {
    float inverse_degree = 0;
    float seen = 0;      // weight of the vertex's row in its neighbours' derivatives
    float membrane = 0;  // of the row before projection, where there is one
  };
  // A place that needs more than its ring's umbrellas: on or beside a rim, among several labels, at a border's corner.
  struct Special {
    uint32_t place = 0;
    int32_t inter = -1;  // in the incidence
    Vector4f extra = Vector4f::Zero();
  };

  template <class Body>
  void ForPlaces(const Body& body) const {
    ParallelFor(static_cast<int64_t>(layout_.vertex_at.size()), kGrain, [&](int64_t begin, int64_t end) {
      for (int64_t p = begin; p < end; ++p) body(static_cast<size_t>(p));
    });
  }

  // An inner vertex whose edges all have one weight: its membrane is a multiple of its umbrella.
  bool Uniform(uint32_t v) const { return !term_.rings_.rim[v] && (!term_.mixed_[v] || weights_.membrane == 0); }

  void FindSpecialPlaces() {
    std::vector<int32_t> inter_at;
    if (inter_) {
      inter_at.assign(layout_.place_of.size(), -1);
      for (size_t i = 0; i < inter_->incidence.vertices.size(); ++i) {
        inter_at[layout_.place_of[inter_->incidence.vertices[i]]] = static_cast<int32_t>(i);
      }
      residuals_.resize(inter_->corners.size());
    }
    for (size_t p = 0; p < layout_.vertex_at.size(); ++p) {
      const int32_t at = inter_ ? inter_at[p] : -1;
      if (!Uniform(layout_.vertex_at[p]) || at >= 0) specials_.push_back({static_cast<uint32_t>(p), at});
    }
  }

  void SetUp(size_t p, const std::vector<Matrix3d>& data, const Positions& rhs) {
    const uint32_t v = layout_.vertex_at[p];
    const OneRings& rings = term_.rings_;
    const double degree = std::max(rings.degree(v), 1u);
    const bool rim = rings.rim[v];
    double own = rim ? weights_.rim : weights_.thin_plate * term_.factor_[v];
    factors_[p].inverse_degree = static_cast<float>(1 / degree);
    factors_[p].seen = rim ? 0 : static_cast<float>(weights_.thin_plate * term_.factor_[v] / degree);
    if (projected_) normals_[p] << term_.normals_[v].cast<float>(), 0;

    // A's own diagonal block, and what holds the eigenvalues below kHigh whatever the degrees:
    // ‖x_v - mean‖² ≤ 2 ‖x_v‖² + 2 mean ‖x_w‖².
    Matrix3d plate = Matrix3d::Zero();
    double diagonal = 0, bound = 0, other = 0, membrane = 0;
    const auto add_row = [&](uint32_t w, double coefficient, double bound_coefficient) {
      const double weight = weights_.thin_plate * term_.factor_[w];
      diagonal += weight * coefficient;
      bound += weight * bound_coefficient;
      if (!projected_) return;
      const Vector3d& normal = term_.normals_[w];
      plate += weight * coefficient * (1 - weights_.tangential) * normal * normal.transpose();
    };
    if (!rim && rings.degree(v) > 0) add_row(v, 1, 2);
    for (uint32_t e = rings.begin[v]; e < rings.begin[v + 1]; ++e) {
      const uint32_t w = rings.to[e];
      const double inverse = 1.0 / rings.degree(w);
      if (!rings.rim[w]) add_row(w, inverse * inverse, 2 * inverse);
      if (rings.inner[e] && !(rim && rings.rim[w])) membrane += weights_.membrane * term_.EdgeFactor(v, w) / 6;
      if (term_.has_rim_row(w) && !rings.inner[e]) other += 0.25 * weights_.rim;
    }
    if (term_.has_rim_row(v)) other += weights_.rim;
    plate.diagonal().array() += diagonal * (projected_ ? weights_.tangential : 1);
    if (bound > kHigh * diagonal) plate *= bound / (kHigh * diagonal);
    if (projected_) {
      factors_[p].membrane = Uniform(v) ? static_cast<float>(membrane) : 0;
    } else if (Uniform(v)) {
      own += membrane;
    }
    Matrix3d block = data[v];
    const auto kept = std::lower_bound(term_.kept_.begin(), term_.kept_.end(), v,
                                       [](const KeptVertex& k, uint32_t vertex) { return k.vertex < vertex; });
    if (kept != term_.kept_.end() && kept->vertex == v) block += weights_.keep * kept->block;
    data_[p] = SymmetricBlock(block);
    rhs_[p] << rhs[v].cast<float>(), static_cast<float>(own);
    if (term_.fixed_[v]) return;
    block += plate;
    block.diagonal().array() += membrane + other;
    if (inter_) AddInterBlocks(p, &block);
    block.diagonal().array() += 1e-6 * block.trace() + 1e-12;
    inverse_[p] = SymmetricBlock(Matrix3d(block.inverse()));
  }

  void AddInterBlocks(size_t p, Matrix3d* block) const {
    const auto special = SpecialFrom(p);
    if (special == specials_.end() || special->place != p || special->inter < 0) return;
    const CornerIncidence& incidence = inter_->incidence;
    for (uint32_t e = incidence.begin[special->inter]; e < incidence.begin[special->inter + 1]; ++e) {
      const uint32_t entry = incidence.entries[e];
      *block += inter_->corners[entry / 3].Block(entry % 3).cast<double>();
    }
  }

  std::vector<Special>::const_iterator SpecialFrom(size_t place) const {
    return std::lower_bound(specials_.begin(), specials_.end(), place,
                            [](const Special& s, size_t at) { return s.place < at; });
  }

  // Calls plain(p) or special(p, specials_[i]) for all places.
  template <class Plain, class AtSpecial>
  void ForPlacesWithSpecials(const Plain& plain, const AtSpecial& at_special) {
    ParallelFor(static_cast<int64_t>(layout_.vertex_at.size()), kGrain, [&](int64_t begin, int64_t end) {
      size_t next = SpecialFrom(static_cast<size_t>(begin)) - specials_.begin();
      for (size_t p = static_cast<size_t>(begin); p < static_cast<size_t>(end);) {
        const size_t stop =
            next < specials_.size() ? std::min<size_t>(specials_[next].place, static_cast<size_t>(end)) : end;
        for (; p < stop; ++p) plain(p);
        if (p < static_cast<size_t>(end)) at_special(p++, specials_[next++]);
      }
    });
  }

  Vector4f UmbrellaAt(size_t p) const {
    Vector4f sum = Vector4f::Zero();
    for (uint32_t e = layout_.ring_begin[p]; e < layout_.ring_begin[p + 1]; ++e) sum += step_[layout_.ring[e]];
    return step_[p] - factors_[p].inverse_degree * sum;
  }

  void StoreRow(size_t p, Vector4f row) {
    if (projected_) {
      raw_rows_[p] = row;
      const float tangential = static_cast<float>(weights_.tangential);
      row = tangential * row + (1 - tangential) * normals_[p].dot(row) * normals_[p];
    }
    row[3] = factors_[p].seen;
    rows_[p] = row;
  }

  // Rows of U step, their weight for the neighbours in the fourth lane; all that needs the step of neighbours.
  void MakeRows() {
    if (inter_) {
      ParallelFor(static_cast<int64_t>(inter_->corners.size()), kGrain, [&](int64_t begin, int64_t end) {
        for (int64_t c = begin; c < end; ++c) {
          const InterCurvature::Corner& corner = inter_->corners[c];
          const auto at = [&](int role) -> Vector3f { return step_[layout_.place_of[corner.vertex[role]]].head<3>(); };
          residuals_[c] = corner.weight * corner.Residual(at(0), at(1), at(2));
        }
      });
    }
    ForPlacesWithSpecials([&](size_t p) { StoreRow(p, UmbrellaAt(p)); },
                          [&](size_t p, Special& special) {
                            const uint32_t v = layout_.vertex_at[p];
                            special.extra.setZero();
                            if (!Uniform(v)) special.extra = MembraneAt(p, v);
                            if (!term_.rings_.rim[v]) {
                              StoreRow(p, UmbrellaAt(p));
                              return;
                            }
                            rows_[p].setZero();
                            if (!term_.has_rim_row(v)) return;
                            const auto [a, b] = term_.rings_.along_rim[v];
                            rows_[p] = step_[p] - 0.5f * (step_[layout_.place_of[a]] + step_[layout_.place_of[b]]);
                          });
  }

  Vector4f MembraneAt(size_t p, uint32_t v) const {
    const OneRings& rings = term_.rings_;
    Vector4f sum = Vector4f::Zero();
    const uint32_t shift = layout_.ring_begin[p] - rings.begin[v];
    for (uint32_t e = rings.begin[v]; e < rings.begin[v + 1]; ++e) {
      const uint32_t w = rings.to[e];
      if (!rings.inner[e] || (rings.rim[v] && rings.rim[w])) continue;
      const float weight = static_cast<float>(weights_.membrane * term_.EdgeFactor(v, w) / 6);
      sum += weight * (step_[p] - step_[layout_.ring[e + shift]]);
    }
    return sum;
  }

  // The rest of A step at a special place, from the rows of others.
  Vector4f SpecialProduct(size_t p, const Special& special) const {
    const OneRings& rings = term_.rings_;
    const uint32_t v = layout_.vertex_at[p];
    Vector4f sum = special.extra;
    if (rings.rim[v]) {
      for (uint32_t e = rings.begin[v]; e < rings.begin[v + 1]; ++e) {
        const uint32_t w = rings.to[e];
        if (!rings.inner[e] && term_.has_rim_row(w)) {
          sum -= static_cast<float>(0.5 * weights_.rim) * rows_[layout_.place_of[w]];
        }
      }
    }
    if (special.inter >= 0) {
      const CornerIncidence& incidence = inter_->incidence;
      for (uint32_t e = incidence.begin[special.inter]; e < incidence.begin[special.inter + 1]; ++e) {
        const uint32_t entry = incidence.entries[e];
        sum.head<3>() += inter_->corners[entry / 3].Transposed(entry % 3, residuals_[entry / 3]);
      }
    }
    return sum;
  }

  void Update(float keep, float gain) {
    const auto update = [&](size_t p, Vector4f product) {
      product += rhs_[p][3] * rows_[p];
      if (projected_) product += factors_[p].membrane * raw_rows_[p];
      for (uint32_t e = layout_.ring_begin[p]; e < layout_.ring_begin[p + 1]; ++e) {
        const Vector4f& row = rows_[layout_.ring[e]];
        product -= row[3] * row;
      }
      const Vector4f residual = rhs_[p] - product - data_[p].Times(step_[p]);
      direction_[p] = keep * direction_[p] + gain * inverse_[p].Times(residual);
      step_[p] += direction_[p];
    };
    ForPlacesWithSpecials([&](size_t p) { update(p, Vector4f::Zero()); },
                          [&](size_t p, const Special& special) { update(p, SpecialProduct(p, special)); });
  }

  const SmoothTerm& term_;
  const Layout& layout_;
  const SmoothWeights& weights_;
  const InterCurvature* inter_;
  const bool projected_;
  std::vector<Factors> factors_;
  std::vector<Special> specials_;    // by rising place
  std::vector<Vector3f> residuals_;  // of inter_'s corners, weighted
  std::vector<Vector4f> rhs_;        // fourth lane: weight of the vertex's own row
  std::vector<Vector4f> rows_, raw_rows_, normals_, direction_, step_;
  std::vector<SymmetricBlock> data_, inverse_;
};

void SmoothTerm::SolveStep(const std::vector<Matrix3d>& data, const Positions& rhs, const SmoothWeights& weights,
                           int sweeps, Positions* step, const InterCurvature* inter) const {
  System system(*this, data, rhs, weights, inter);
  const double centre = 0.5 * (kHigh + kLow), half_width = 0.5 * (kHigh - kLow);
  const double sigma = centre / half_width;
  double rho = 1 / sigma;
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    double keep = 0, gain = 1 / centre;
    if (sweep > 0) {
      const double next = 1 / (2 * sigma - rho);
      keep = next * rho;
      gain = 2 * next / half_width;
      rho = next;
    }
    system.Sweep(static_cast<float>(keep), static_cast<float>(gain));
  }
  system.TakeStep(step);
}

}  // namespace tessera
