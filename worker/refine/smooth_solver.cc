// SmoothTerm::SolveStep in single precision: two passes over the vertices per sweep. Chebyshev iteration instead of
// conjugate gradients: it has no dot products over the mesh, so a vertex depends only on its neighbourhood and the
// result does not depend on the number of threads or tiles.
#include <Eigen/Core>
#include <algorithm>
#include <limits>
#include <tuple>
#include <utility>

#include "common/base/loops/parallel_sort.h"
#include "common/base/loops/uninitialized_vector.h"
#include "common/base/parallel.h"
#include "worker/refine/inter_term.h"
#include "worker/refine/morton.h"
#include "worker/refine/smooth_term.h"

namespace tessera {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr int64_t kGrain = 4096;
constexpr int64_t kSpecialGrain = 512;
// Bounds of the eigenvalues of the preconditioned matrix. The preconditioner guarantees kHigh; the lower one only
// determines which smooth modes are left to the next call.
constexpr double kHigh = 3.5, kLow = 0.01;

// Four lanes of SSE (or NEON): x, y, z and one additional value.
using Lanes = float __attribute__((vector_size(16)));

Lanes ToLanes(const Vector3f& v, float fourth) { return Lanes{v.x(), v.y(), v.z(), fourth}; }
Vector3f FromLanes(const Lanes& v) { return {v[0], v[1], v[2]}; }
Lanes Broadcast(float x) { return Lanes{x, x, x, x}; }
Lanes Fourth(const Lanes& v) { return __builtin_shufflevector(v, v, 3, 3, 3, 3); }
Lanes ShiftUp(const Lanes& v) { return __builtin_shufflevector(v, v, 1, 2, 0, 3); }
Lanes ShiftDown(const Lanes& v) { return __builtin_shufflevector(v, v, 2, 0, 1, 3); }

// A vector; its fourth lane is unspecified.
struct Vector {
  Lanes lanes;
};

// A vertex's row of the umbrella (or of its boundary) and, in the fourth lane, the row's weight in the derivatives of
// its neighbours.
struct Row {
  Lanes lanes;

  Lanes WeightAtNeighbours() const { return Fourth(lanes); }
  void SetWeightAtNeighbours(float weight) { lanes[3] = weight; }
  void SetVector(Lanes vector) {
    vector[3] = lanes[3];
    lanes = vector;
  }
};

// A vertex's right-hand side and, in the fourth lane, the weight of its row in its own derivative.
struct RightSide {
  Lanes lanes;

  Lanes WeightOfOwnRow() const { return Fourth(lanes); }
};

// A symmetric 3x3 block.
struct SymmetricBlock {
  Lanes diagonal = {0, 0, 0, 0};  // xx, yy, zz
  Lanes beside = {0, 0, 0, 0};    // xy, yz, zx

  SymmetricBlock() = default;
  explicit SymmetricBlock(const Matrix3d& m)
      : diagonal(ToLanes(m.diagonal().cast<float>(), 0)),
        beside(ToLanes(Vector3d(m(0, 1), m(1, 2), m(2, 0)).cast<float>(), 0)) {}

  // The fourth lane becomes zero.
  Lanes Times(const Lanes& v) const { return diagonal * v + beside * ShiftUp(v) + ShiftDown(beside) * ShiftDown(v); }
};

// Inverse of a symmetric, positive definite block.
Matrix3d Inverse(const Matrix3d& m) {
  Matrix3d out;
  const double xx = m(1, 1) * m(2, 2) - m(1, 2) * m(1, 2), xy = m(0, 2) * m(1, 2) - m(0, 1) * m(2, 2),
               xz = m(0, 1) * m(1, 2) - m(0, 2) * m(1, 1);
  const double scale = 1 / (m(0, 0) * xx + m(0, 1) * xy + m(0, 2) * xz);
  out(0, 0) = scale * xx;
  out(0, 1) = out(1, 0) = scale * xy;
  out(0, 2) = out(2, 0) = scale * xz;
  out(1, 1) = scale * (m(0, 0) * m(2, 2) - m(0, 2) * m(0, 2));
  out(1, 2) = out(2, 1) = scale * (m(0, 1) * m(0, 2) - m(0, 0) * m(1, 2));
  out(2, 2) = scale * (m(0, 0) * m(1, 1) - m(0, 1) * m(0, 1));
  return out;
}

// Number of rings per band.
constexpr int kBandRings = 4;

// Memory order of the vertices: band by band, within a band along a Morton curve through `positions`, and within
// blocks of the curve sorted by degree, for branch prediction.
std::vector<uint32_t> MemoryOrder(const std::vector<Vector3d>& positions, const OneRings& rings,
                                  const std::vector<int>& band) {
  const std::vector<uint64_t> keys = MortonKeys(positions);
  std::vector<std::tuple<int, uint64_t, uint32_t>> keyed(positions.size());
  ParallelForEach(positions.size(), kGrain,
                  [&](size_t v) { keyed[v] = {band[v], keys[v], static_cast<uint32_t>(v)}; });
  ParallelSort(&keyed);
  constexpr size_t kBlock = 1024;
  std::vector<uint32_t> order(positions.size());
  std::vector<size_t> blocks = {0};
  for (size_t i = 0; i < order.size(); ++i) {
    order[i] = std::get<2>(keyed[i]);
    if (i - blocks.back() == kBlock || band[order[i]] != band[order[blocks.back()]]) blocks.push_back(i);
  }
  blocks.push_back(order.size());
  ParallelForEach(blocks.size() - 1, 4, [&](size_t b) {
    std::stable_sort(order.begin() + static_cast<ptrdiff_t>(blocks[b]),
                     order.begin() + static_cast<ptrdiff_t>(blocks[b + 1]),
                     [&](uint32_t i, uint32_t j) { return rings.degree(i) < rings.degree(j); });
  });
  return order;
}

// Distance of each vertex from the flagged ones in bands; 0 without flags.
std::vector<int> BandsFrom(const std::vector<uint8_t>& active, const OneRings& rings) {
  std::vector<int> away(rings.on_boundary.size(), active.empty() ? 0 : -1);
  std::vector<uint32_t> front, next;
  for (uint32_t v = 0; v < active.size(); ++v) {
    if (!active[v]) continue;
    away[v] = 0;
    front.push_back(v);
  }
  for (int ring = 1; !front.empty(); ++ring, front.swap(next), next.clear()) {
    for (const uint32_t v : front) {
      for (uint32_t e = rings.begin[v]; e < rings.begin[v + 1]; ++e) {
        const uint32_t w = rings.to[e];
        if (away[w] >= 0) continue;
        away[w] = ring;
        next.push_back(w);
      }
    }
  }
  for (int& ring : away) ring = ring < 0 ? std::numeric_limits<int>::max() : (ring + kBandRings - 1) / kBandRings;
  return away;
}

}  // namespace

// Slots are positions in memory order. Neighbours keep the order of their vertex indices, so the memory order does
// not change any sum.
struct SmoothTerm::Layout {
  std::vector<uint32_t> vertex_at;  // vertex of each slot
  std::vector<uint32_t> slot_of;    // slot of each vertex
  std::vector<uint32_t> ring_begin, ring;
  // Ends of the slots of the active vertices, then of each further band of kBandRings rings.
  std::vector<uint32_t> band_end;

  // Number of leading slots that contain all vertices within `rings` rings of the active ones.
  size_t SlotsWithin(int rings) const {
    const size_t band = (rings + kBandRings - 1) / kBandRings;
    return band < band_end.size() ? band_end[band] : band_end.empty() ? vertex_at.size() : band_end.back();
  }
};

void SmoothTerm::MakeLayout(const std::vector<uint8_t>& active) {
  auto layout = std::make_shared<Layout>();
  const std::vector<int> band = BandsFrom(active, rings_);
  layout->vertex_at = MemoryOrder(start_, rings_, band);
  for (size_t p = 0; p < start_.size() && band[layout->vertex_at[p]] != std::numeric_limits<int>::max(); ++p) {
    layout->band_end.resize(band[layout->vertex_at[p]] + 1, static_cast<uint32_t>(p));
    layout->band_end.back() = static_cast<uint32_t>(p + 1);
  }
  layout->slot_of.resize(start_.size());
  layout->ring_begin.assign(start_.size() + 1, 0);
  for (size_t p = 0; p < start_.size(); ++p) {
    layout->slot_of[layout->vertex_at[p]] = static_cast<uint32_t>(p);
    layout->ring_begin[p + 1] = layout->ring_begin[p] + rings_.degree(layout->vertex_at[p]);
  }
  layout->ring.resize(rings_.to.size());
  ParallelForEach(start_.size(), kGrain, [&](size_t p) {
    const uint32_t v = layout->vertex_at[p];
    uint32_t* to = layout->ring.data() + layout->ring_begin[p];
    for (uint32_t e = rings_.begin[v]; e < rings_.begin[v + 1]; ++e) *to++ = layout->slot_of[rings_.to[e]];
  });
  layout_ = std::move(layout);
}

void SmoothTerm::FindDiagonals() {
  diagonals_.resize(start_.size());
  ParallelForEach(start_.size(), kGrain, [&](int64_t p) {
    const uint32_t v = layout_->vertex_at[p];
    const bool boundary = rings_.on_boundary[v];
    Diagonals out;
    double plate = 0, bound = 0;
    out.inverse_degree = static_cast<float>(1.0 / std::max(rings_.degree(v), 1u));
    if (!boundary && rings_.degree(v) > 0) {
      plate = factor_[v];
      bound = 2 * factor_[v];
      out.factor = static_cast<float>(factor_[v]);
    }
    double membrane = 0;
    for (uint32_t e = rings_.begin[v]; e < rings_.begin[v + 1]; ++e) {
      const uint32_t w = rings_.to[e];
      const double inverse = 1.0 / rings_.degree(w);
      if (!rings_.on_boundary[w]) {
        plate += factor_[w] * inverse * inverse;
        bound += 2 * factor_[w] * inverse;
      }
      if (rings_.inner[e] && !(boundary && rings_.on_boundary[w])) membrane += EdgeFactor(v, w) / 6;
      if (has_boundary_row(w) && !rings_.inner[e]) out.boundary += 0.25f;
    }
    if (has_boundary_row(v)) out.boundary += 1;
    out.plate = static_cast<float>(plate);
    out.slack = plate > 0 ? static_cast<float>(std::max(1.0, bound / (kHigh * plate))) : 1;
    out.membrane = static_cast<float>(membrane);
    out.special = boundary || mixed_[v];
    diagonals_[p] = out;
  });
}

// The system of one call, in memory order.
class SmoothTerm::System {
 public:
  // Sets up the first `slots`.
  System(const SmoothTerm& term, const std::vector<Matrix3d>& data, const Positions& rhs, const SmoothWeights& weights,
         const InterCurvature* inter, size_t slots)
      : term_(term),
        layout_(*term.layout_),
        weights_(weights),
        inter_(inter),
        data_(rhs.size()),
        inverse_(rhs.size()),
        rhs_(rhs.size()),
        rows_(rhs.size()),
        direction_(rhs.size()),
        step_(rhs.size()) {
    FindSpecials();
    ParallelForEach(rhs.size(), kGrain, [&](size_t p) {
      Clear(p);
      if (p < slots) SetUp(p, data[layout_.vertex_at[p]], rhs[layout_.vertex_at[p]]);
    });
    ForSpecials(slots, [&](Special& special) { special.rhs = rhs_[special.slot].lanes; });
  }

  // A sweep reads the previous one within two rings. So each sweep only computes the vertices within `rings` rings of
  // the active ones, which later sweeps read.

  // Starts from a zero step.
  void FirstSweep(float gain, int rings) {
    ParallelForEach(layout_.SlotsWithin(rings), kGrain, [&](size_t p) {
      direction_[p].lanes = Broadcast(gain) * inverse_[p].Times(rhs_[p].lanes);
      step_[p] = direction_[p];
    });
  }

  void Sweep(float keep, float gain, int rings) {
    const size_t rows = layout_.SlotsWithin(rings + 1), slots = layout_.SlotsWithin(rings);
    MakeRows(rows);
    if (inter_) MakeResiduals();
    ForSpecials(rows, [&](Special& special) { MakeSpecialRow(&special); });
    ForSpecials(slots, [&](Special& special) { rhs_[special.slot].lanes = special.rhs - SpecialProduct(special); });
    Update(slots, Broadcast(keep), Broadcast(gain));
  }

  void TakeStep(Positions* step) const {
    step->resize(step_.size());
    const size_t slots = layout_.SlotsWithin(0);
    ParallelForEach(step_.size(), kGrain, [&](size_t p) {
      Vector3d& to = (*step)[layout_.vertex_at[p]];
      to = p < slots ? Vector3d(FromLanes(step_[p].lanes).cast<double>()) : Vector3d(Vector3d::Zero());
    });
  }

 private:
  // A vertex with terms in addition to its ring's umbrellas: on a boundary, with mixed labels, or at a border's
  // corner. Its additional terms are moved to the right-hand side of the sweep.
  struct Special {
    uint32_t slot = 0;
    int32_t inter = -1;                    // index in the incidence
    uint32_t edges_begin = 0, edges = 0;  // in edge_weights_; none without a membrane of its own
    Lanes rhs = {0, 0, 0, 0}, membrane = {0, 0, 0, 0};
  };

  // The specials among the first `slots`.
  template <class Body>
  void ForSpecials(size_t slots, const Body& body) {
    const auto beyond = std::partition_point(specials_.begin(), specials_.end(),
                                             [&](const Special& special) { return special.slot < slots; });
    ParallelForEach(beyond - specials_.begin(), kSpecialGrain, [&](int64_t i) { body(specials_[i]); });
  }

  void FindSpecials() {
    std::vector<int32_t> inter_at;
    if (inter_) {
      inter_at.assign(layout_.slot_of.size(), -1);
      for (size_t i = 0; i < inter_->incidence.vertices.size(); ++i) {
        inter_at[layout_.slot_of[inter_->incidence.vertices[i]]] = static_cast<int32_t>(i);
      }
      residuals_.resize(inter_->corners.size());
    }
    const auto count = static_cast<int64_t>(layout_.vertex_at.size());
    std::vector<std::vector<Special>> parts((count + kGrain - 1) / kGrain);
    ParallelFor(count, kGrain, [&](int64_t begin, int64_t end) {
      for (int64_t p = begin; p < end; ++p) {
        const int32_t at = inter_ ? inter_at[p] : -1;
        if (!term_.diagonals_[p].special && at < 0) continue;
        Special special = {static_cast<uint32_t>(p), at};
        if (term_.diagonals_[p].special && weights_.membrane != 0) {
          special.edges = layout_.ring_begin[p + 1] - layout_.ring_begin[p];
        }
        parts[begin / kGrain].push_back(special);
      }
    });
    uint32_t edge_count = 0;
    for (const std::vector<Special>& part : parts) {
      for (Special special : part) {
        special.edges_begin = edge_count;
        edge_count += special.edges;
        specials_.push_back(special);
      }
    }
    edge_weights_.resize(edge_count);
    ParallelForEach(specials_.size(), kSpecialGrain, [&](size_t i) { WeighEdges(specials_[i]); });
  }

  // The membrane's weights of the edges about a special vertex; 0 of edges without a membrane.
  void WeighEdges(const Special& special) {
    const OneRings& rings = term_.rings_;
    const uint32_t v = layout_.vertex_at[special.slot];
    for (uint32_t i = 0; i < special.edges; ++i) {
      const uint32_t e = rings.begin[v] + i, w = rings.to[e];
      if (!rings.inner[e] || (rings.on_boundary[v] && rings.on_boundary[w])) continue;
      edge_weights_[special.edges_begin + i] = static_cast<float>(weights_.membrane * term_.EdgeFactor(v, w) / 6);
    }
  }

  void Clear(size_t p) {
    data_[p] = inverse_[p] = SymmetricBlock();
    const Lanes zero = {0, 0, 0, 0};
    rhs_[p].lanes = rows_[p].lanes = direction_[p].lanes = step_[p].lanes = zero;
  }

  void SetUp(size_t p, const Matrix3d& data, const Vector3d& rhs) {
    const uint32_t v = layout_.vertex_at[p];
    const Diagonals& diagonals = term_.diagonals_[p];
    const float plate_weight = static_cast<float>(weights_.thin_plate),
                boundary_weight = static_cast<float>(weights_.boundary);
    const float membrane = static_cast<float>(weights_.membrane) * diagonals.membrane;
    const bool boundary = term_.rings_.on_boundary[v];
    rows_[p].SetWeightAtNeighbours(plate_weight * diagonals.factor * diagonals.inverse_degree);
    float own = boundary ? boundary_weight : plate_weight * diagonals.factor;
    // If all edges have the same weight, the membrane is a multiple of the umbrella.
    if (!diagonals.special) own += membrane;
    rhs_[p].lanes = ToLanes(rhs.cast<float>(), own);

    Matrix3d block = data;
    if (!term_.anchored_.empty()) {
      const auto anchored =
          std::lower_bound(term_.anchored_.begin(), term_.anchored_.end(), v,
                           [](const AnchoredVertex& k, uint32_t vertex) { return k.vertex < vertex; });
      if (anchored != term_.anchored_.end() && anchored->vertex == v) block += weights_.anchor * anchored->block;
    }
    data_[p] = SymmetricBlock(block);
    if (term_.fixed_[v]) return;
    block.diagonal().array() += plate_weight * diagonals.plate * diagonals.slack;
    block.diagonal().array() += membrane + boundary_weight * diagonals.boundary;
    if (inter_) AddInterBlocks(p, &block);
    block.diagonal().array() += 1e-6 * block.trace() + 1e-12;
    inverse_[p] = SymmetricBlock(Inverse(block));
  }

  void AddInterBlocks(size_t p, Matrix3d* block) const {
    const auto special = std::lower_bound(specials_.begin(), specials_.end(), p,
                                          [](const Special& s, size_t slot) { return s.slot < slot; });
    if (special == specials_.end() || special->slot != p || special->inter < 0) return;
    const CornerIncidence& incidence = inter_->incidence;
    for (uint32_t e = incidence.begin[special->inter]; e < incidence.begin[special->inter + 1]; ++e) {
      const uint32_t entry = incidence.entries[e];
      *block += inter_->corners[entry / 3].Block(entry % 3).cast<double>();
    }
  }

  void MakeRows(size_t slots) {
    const Vector* step = step_.data();
    const uint32_t *ring_begin = layout_.ring_begin.data(), *ring = layout_.ring.data();
    const Diagonals* diagonals = term_.diagonals_.data();
    Row* rows = rows_.data();
    ParallelForEach(slots, kGrain, [=](int64_t p) {
      Lanes sum = {0, 0, 0, 0};
      for (uint32_t e = ring_begin[p], stop = ring_begin[p + 1]; e < stop; ++e) sum += step[ring[e]].lanes;
      rows[p].SetVector(step[p].lanes - Broadcast(diagonals[p].inverse_degree) * sum);
    });
  }

  void MakeResiduals() {
    ParallelForEach(inter_->corners.size(), kSpecialGrain, [&](int64_t c) {
      const InterCurvature::Corner& corner = inter_->corners[c];
      const auto at = [&](int role) { return FromLanes(step_[layout_.slot_of[corner.vertex[role]]].lanes); };
      residuals_[c] = corner.weight * corner.Residual(at(0), at(1), at(2));
    });
  }

  // Boundary rows replace umbrellas; the membrane of edges with unequal weights.
  void MakeSpecialRow(Special* special) {
    const OneRings& rings = term_.rings_;
    const size_t p = special->slot;
    const uint32_t v = layout_.vertex_at[p];
    if (rings.on_boundary[v]) {
      const auto [a, b] = rings.along_boundary[v];
      Lanes row = {0, 0, 0, 0};
      if (term_.has_boundary_row(v)) {
        row = step_[p].lanes - 0.5f * (step_[layout_.slot_of[a]].lanes + step_[layout_.slot_of[b]].lanes);
      }
      rows_[p].SetVector(row);
    }
    special->membrane = Lanes{0, 0, 0, 0};
    const uint32_t* slots = layout_.ring.data() + layout_.ring_begin[p];
    const float* weights = edge_weights_.data() + special->edges_begin;
    for (uint32_t e = 0; e < special->edges; ++e) {
      special->membrane += Broadcast(weights[e]) * (step_[p].lanes - step_[slots[e]].lanes);
    }
  }

  // The terms of A step at a special vertex beyond its ring's umbrellas.
  Lanes SpecialProduct(const Special& special) const {
    const OneRings& rings = term_.rings_;
    const uint32_t v = layout_.vertex_at[special.slot];
    Lanes sum = special.membrane;
    if (rings.on_boundary[v]) {
      for (uint32_t e = rings.begin[v]; e < rings.begin[v + 1]; ++e) {
        const uint32_t w = rings.to[e];
        if (rings.inner[e] || !term_.has_boundary_row(w)) continue;
        sum -= Broadcast(static_cast<float>(0.5 * weights_.boundary)) * rows_[layout_.slot_of[w]].lanes;
      }
    }
    if (special.inter >= 0) {
      const CornerIncidence& incidence = inter_->incidence;
      for (uint32_t e = incidence.begin[special.inter]; e < incidence.begin[special.inter + 1]; ++e) {
        const uint32_t entry = incidence.entries[e];
        sum += ToLanes(inter_->corners[entry / 3].Transposed(entry % 3, residuals_[entry / 3]), 0);
      }
    }
    sum[3] = 0;
    return sum;
  }

  void Update(size_t slots, Lanes keep, Lanes gain) {
    const uint32_t *ring_begin = layout_.ring_begin.data(), *ring = layout_.ring.data();
    const Row* rows = rows_.data();
    const RightSide* rhs = rhs_.data();
    const SymmetricBlock *data = data_.data(), *inverse = inverse_.data();
    Vector *direction = direction_.data(), *step = step_.data();
    ParallelForEach(slots, kGrain, [=](int64_t p) {
      Lanes product = {0, 0, 0, 0};
      for (uint32_t e = ring_begin[p], stop = ring_begin[p + 1]; e < stop; ++e) {
        const Row row = rows[ring[e]];
        product += row.WeightAtNeighbours() * row.lanes;
      }
      Lanes residual = rhs[p].lanes + product - rhs[p].WeightOfOwnRow() * rows[p].lanes;
      residual -= data[p].Times(step[p].lanes);
      const Lanes move = keep * direction[p].lanes + gain * inverse[p].Times(residual);
      direction[p].lanes = move;
      step[p].lanes += move;
    });
  }

  const SmoothTerm& term_;
  const Layout& layout_;
  const SmoothWeights& weights_;
  const InterCurvature* inter_;
  std::vector<Special> specials_;    // ascending by slot
  std::vector<float> edge_weights_;
  std::vector<Vector3f> residuals_;  // of inter_'s corners, weighted
  // Set by the constructor for the slots that are used, and zero in the others.
  UninitializedVector<SymmetricBlock> data_, inverse_;
  UninitializedVector<RightSide> rhs_;
  UninitializedVector<Row> rows_;
  UninitializedVector<Vector> direction_, step_;
};

void SmoothTerm::SolveStep(const std::vector<Matrix3d>& data, const Positions& rhs, const SmoothWeights& weights,
                           int sweeps, Positions* step, const InterCurvature* inter) const {
  System system(*this, data, rhs, weights, inter, layout_->SlotsWithin(SolveRings(sweeps)));
  const double centre = 0.5 * (kHigh + kLow), half_width = 0.5 * (kHigh - kLow);
  const double sigma = centre / half_width;
  double rho = 1 / sigma;
  if (sweeps > 0) system.FirstSweep(static_cast<float>(1 / centre), SolveRings(sweeps));
  for (int sweep = 1; sweep < sweeps; ++sweep) {
    const double next = 1 / (2 * sigma - rho);
    system.Sweep(static_cast<float>(next * rho), static_cast<float>(2 * next / half_width), SolveRings(sweeps - sweep));
    rho = next;
  }
  system.TakeStep(step);
}

}  // namespace tessera
