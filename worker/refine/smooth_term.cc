#include "worker/refine/smooth_term.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>

#include "common/base/parallel.h"

namespace tessera {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int64_t kGrain = 2048;

template <class Body>
void ForVertices(size_t count, const Body& body) {
  ParallelFor(static_cast<int64_t>(count), kGrain, [&](int64_t begin, int64_t end) {
    for (int64_t v = begin; v < end; ++v) body(static_cast<size_t>(v));
  });
}

struct DirectedEdge {
  uint32_t from, to;
  bool operator==(const DirectedEdge&) const = default;
  bool operator<(const DirectedEdge& o) const { return from != o.from ? from < o.from : to < o.to; }
};

}  // namespace

SmoothTerm::SmoothTerm(const TriangleMesh& mesh, const std::vector<uint8_t>& fixed)
    : start_(mesh.vertices), fixed_(fixed) {
  const size_t n = mesh.vertices.size();
  if (fixed_.empty()) fixed_.assign(n, 0);
  std::vector<DirectedEdge> edges;
  edges.reserve(mesh.faces.size() * 6);
  for (const Triangle& face : mesh.faces) {
    for (int k = 0; k < 3; ++k) {
      edges.push_back({face[k], face[(k + 1) % 3]});
      edges.push_back({face[(k + 1) % 3], face[k]});
    }
  }
  std::sort(edges.begin(), edges.end());
  rim_.assign(n, 0);
  ring_begin_.assign(n + 1, 0);
  for (size_t i = 0; i < edges.size();) {
    size_t end = i;
    while (end < edges.size() && edges[end] == edges[i]) ++end;
    const bool inner = end - i == 2;
    ring_.push_back(edges[i].to);
    ring_inner_.push_back(inner);
    ++ring_begin_[edges[i].from + 1];
    if (!inner) rim_[edges[i].from] = 1;
    i = end;
  }
  for (size_t v = 0; v < n; ++v) ring_begin_[v + 1] += ring_begin_[v];

  rim_neighbours_.assign(n, {0, 0});
  has_rim_row_.assign(n, 0);
  for (size_t v = 0; v < n; ++v) {
    if (!rim_[v] || fixed_[v]) continue;
    int count = 0;
    for (uint32_t e = ring_begin_[v]; e < ring_begin_[v + 1]; ++e) {
      if (ring_inner_[e]) continue;
      if (count < 2) rim_neighbours_[v][count] = ring_[e];
      ++count;
    }
    has_rim_row_[v] = count == 2;
  }
  diagonal_plate_.assign(n, 0);
  diagonal_rim_.assign(n, 0);
  for (size_t v = 0; v < n; ++v) {
    const uint32_t degree = ring_begin_[v + 1] - ring_begin_[v];
    if (!rim_[v] && degree > 0) {
      diagonal_plate_[v] += 1;
      for (uint32_t e = ring_begin_[v]; e < ring_begin_[v + 1]; ++e) {
        diagonal_plate_[ring_[e]] += 1.0 / (static_cast<double>(degree) * degree);
      }
    }
    if (has_rim_row_[v]) {
      diagonal_rim_[v] += 1;
      for (uint32_t w : rim_neighbours_[v]) diagonal_rim_[w] += 0.25;
    }
  }
}

void SmoothTerm::Umbrella(const Positions& x, const Positions* rim_reference, Positions* out) const {
  out->resize(x.size());
  ForVertices(x.size(), [&](size_t v) {
    const uint32_t begin = ring_begin_[v], end = ring_begin_[v + 1];
    Vector3d row = Vector3d::Zero();
    if (has_rim_row_[v]) {
      const auto [a, b] = rim_neighbours_[v];
      row = x[v] - 0.5 * (x[a] + x[b]);
      if (rim_reference) row -= (*rim_reference)[v] - 0.5 * ((*rim_reference)[a] + (*rim_reference)[b]);
    } else if (!rim_[v] && end > begin) {
      Vector3d sum = Vector3d::Zero();
      for (uint32_t e = begin; e < end; ++e) sum += x[ring_[e]];
      row = x[v] - sum / static_cast<double>(end - begin);
    }
    (*out)[v] = row;
  });
}

void SmoothTerm::Apply(const Positions& x, const SmoothWeights& weights, const Positions* rim_reference,
                       Positions* out) const {
  Positions rows;
  Umbrella(x, rim_reference, &rows);
  out->resize(x.size());
  ForVertices(x.size(), [&](size_t v) {
    if (fixed_[v]) {
      (*out)[v].setZero();
      return;
    }
    Vector3d plate = Vector3d::Zero(), membrane = Vector3d::Zero(), rim = Vector3d::Zero();
    (rim_[v] ? rim : plate) = rows[v];
    for (uint32_t e = ring_begin_[v]; e < ring_begin_[v + 1]; ++e) {
      const uint32_t w = ring_[e];
      if (!rim_[w]) plate -= rows[w] / static_cast<double>(ring_begin_[w + 1] - ring_begin_[w]);
      if (has_rim_row_[w] && !ring_inner_[e]) rim -= 0.5 * rows[w];
      if (ring_inner_[e] && !rim_[v]) membrane += (x[v] - x[w]) / 6;
      if (ring_inner_[e] && rim_[v] && !rim_[w]) membrane += (x[v] - x[w]) / 6;
    }
    (*out)[v] = weights.thin_plate * plate + weights.membrane * membrane + weights.rim * rim;
  });
}

double SmoothTerm::Energy(const Positions& v, const SmoothWeights& weights) const {
  Positions rows;
  Umbrella(v, &start_, &rows);
  return ParallelSum(static_cast<int64_t>(v.size()), kGrain, [&](int64_t begin, int64_t end) {
    double sum = 0;
    for (int64_t k = begin; k < end; ++k) {
      sum += 0.5 * (rim_[k] ? weights.rim : weights.thin_plate) * rows[k].squaredNorm();
      for (uint32_t e = ring_begin_[k]; e < ring_begin_[k + 1]; ++e) {
        const uint32_t w = ring_[e];
        if (!ring_inner_[e] || (rim_[k] && rim_[w])) continue;
        sum += 0.25 * weights.membrane * (v[k] - v[w]).squaredNorm() / 6;  // each edge comes twice
      }
    }
    return sum;
  });
}

void SmoothTerm::Gradient(const Positions& v, const SmoothWeights& weights, Positions* gradient) const {
  Apply(v, weights, &start_, gradient);
}

void SmoothTerm::SolveStep(const std::vector<Matrix3d>& data, const Positions& rhs, const SmoothWeights& weights,
                           int sweeps, Positions* step) const {
  const size_t n = rhs.size();
  std::vector<Matrix3d> inverse(n);
  ForVertices(n, [&](size_t v) {
    double diagonal = weights.thin_plate * diagonal_plate_[v] + weights.rim * diagonal_rim_[v];
    diagonal += weights.membrane * static_cast<double>(ring_begin_[v + 1] - ring_begin_[v]) / 6;
    Matrix3d block = data[v];
    block.diagonal().array() += diagonal + 1e-12 * (1 + block.trace());
    if (fixed_[v]) {
      inverse[v].setZero();
    } else {
      inverse[v] = block.inverse();
    }
  });
  // Eigenvalues of the preconditioned matrix: at most 2²/(1 + 1/6) for the umbrella squared, and the low end only sets
  // which smooth modes are left to the next call.
  const double high = 3.5, low = 0.08;
  const double centre = 0.5 * (high + low), half_width = 0.5 * (high - low);
  step->assign(n, Vector3d::Zero());
  Positions direction(n, Vector3d::Zero()), product;
  double rho = half_width / centre;
  const double sigma = centre / half_width;
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    Apply(*step, weights, nullptr, &product);
    double keep = 0, gain = 1 / centre;
    if (sweep > 0) {
      const double next = 1 / (2 * sigma - rho);
      keep = next * rho;
      gain = 2 * next / half_width;
      rho = next;
    }
    ForVertices(n, [&](size_t v) {
      if (fixed_[v]) return;
      const Vector3d residual = rhs[v] - product[v] - data[v] * (*step)[v];
      direction[v] = keep * direction[v] + gain * (inverse[v] * residual);
      (*step)[v] += direction[v];
    });
  }
}

}  // namespace tessera
