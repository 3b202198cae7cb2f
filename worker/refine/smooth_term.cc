#include "worker/refine/smooth_term.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "common/base/parallel.h"

namespace tessera {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int64_t kGrain = 2048;
constexpr int32_t kNoLabel = -1;

}  // namespace

SmoothTerm::SmoothTerm(const StartSurface& start, const std::vector<uint8_t>& fixed, const std::vector<uint8_t>& active)
    : surface_(start),
      start_(surface_.mesh().vertices),
      faces_(surface_.mesh().faces),
      faces_of_vertex_(surface_.faces_of_vertex()),
      fixed_(fixed),
      rings_(FindOneRings(surface_.mesh(), faces_of_vertex_)) {
  if (fixed_.empty()) fixed_.assign(start_.size(), 0);
  MakeLayout(active);
  SetLabels({}, {}, 0);
}

void SmoothTerm::SetLabels(const std::vector<int32_t>& labels, const std::vector<ClassSmoothness>& classes,
                           double mixed) {
  const size_t n = start_.size();
  factor_.assign(n, 1);
  mixed_.assign(n, 0);
  anchored_.clear();
  class_factor_.clear();
  if (labels.empty()) {
    FindDiagonals();
    return;
  }
  const auto class_of = [&](size_t face) { return labels[face] < 0 || labels[face] == 255 ? kNoLabel : labels[face]; };
  const auto settings = [&](int32_t label) {
    const bool given = label != kNoLabel && static_cast<size_t>(label) < classes.size();
    return given ? classes[label] : ClassSmoothness();
  };
  std::vector<uint8_t> has_anchor(n);
  ParallelForEach(n, kGrain, [&](size_t v) {
    if (faces_of_vertex_[v].empty()) return;
    const int32_t label = class_of(faces_of_vertex_[v][0]);
    for (const uint32_t f : faces_of_vertex_[v]) {
      if (class_of(f) != label) mixed_[v] = 1;
      if (settings(class_of(f)).anchor > 0) has_anchor[v] = 1;
    }
    factor_[v] = mixed_[v] ? mixed : settings(label).smoothness;
  });
  class_factor_ = factor_;
  FindDiagonals();

  if (std::find(has_anchor.begin(), has_anchor.end(), 1) == has_anchor.end()) return;
  std::vector<uint32_t> slot(n);
  for (size_t v = 0; v < n; ++v) {
    slot[v] = static_cast<uint32_t>(anchored_.size());
    if (has_anchor[v] && !fixed_[v]) anchored_.push_back({static_cast<uint32_t>(v), Matrix3d::Zero()});
  }
  if (anchored_.empty()) return;
  std::vector<uint32_t> faces_at(n);
  for (size_t f = 0; f < faces_.size(); ++f) {
    const auto [a, b, c] = faces_[f];
    const double anchor = settings(class_of(f)).anchor;
    const Vector3d normal = (start_[b] - start_[a]).cross(start_[c] - start_[a]).stableNormalized();
    for (uint32_t v : faces_[f]) {
      ++faces_at[v];
      if (anchor > 0 && !fixed_[v]) anchored_[slot[v]].block += anchor * normal * normal.transpose();
    }
  }
  for (AnchoredVertex& anchored : anchored_) anchored.block /= faces_at[anchored.vertex];
}

void SmoothTerm::Reweight(const Positions& v, const CreaseWeights& creases) {
  if (creases.bend <= 0 || class_factor_.empty()) return;
  const std::vector<double> before = Bends(v);
  Positions at = v, rows;
  for (int step = 0; step < kCreaseSteps; ++step) {
    Umbrella(at, &rows);
    ParallelForEach(at.size(), kGrain, [&](size_t k) {
      if (!rings_.on_boundary[k]) at[k] -= 0.5 * rows[k];
    });
  }
  const std::vector<double> after = Bends(at);
  const auto relative = [&](double bend) { return bend * bend / (creases.bend * creases.bend); };
  ParallelForEach(at.size(), kGrain, [&](size_t k) {
    factor_[k] = class_factor_[k];
    if (rings_.on_boundary[k] || rings_.degree(k) == 0) return;
    const double bends = relative(after[k]), expected = relative(kCreaseShrinks * before[k]);
    factor_[k] *= creases.flat / (1 + bends / (1 + creases.rough * std::max(0.0, expected - bends)));
  });
  FindDiagonals();
}

std::vector<double> SmoothTerm::Bends(const Positions& v) const {
  Positions rows, crosses(faces_.size());
  Umbrella(v, &rows);
  ParallelForEach(faces_.size(), kGrain, [&](size_t f) {
    const auto& [a, b, c] = faces_[f];
    crosses[f] = (v[b] - v[a]).cross(v[c] - v[a]);
  });
  std::vector<double> bends(v.size(), 0);
  ParallelForEach(v.size(), kGrain, [&](size_t k) {
    if (rings_.on_boundary[k] || rings_.degree(k) == 0) return;
    double edges = 0;
    for (uint32_t e = rings_.begin[k]; e < rings_.begin[k + 1]; ++e) edges += (v[rings_.to[e]] - v[k]).norm();
    Vector3d normal = Vector3d::Zero();
    for (const uint32_t f : faces_of_vertex_[k]) normal += crosses[f];
    if (edges > 0) bends[k] = std::abs(normal.stableNormalized().dot(rows[k])) * rings_.degree(k) / edges;
  });
  return bends;
}

void SmoothTerm::Umbrella(const Positions& v, Positions* rows) const {
  rows->resize(v.size());
  ParallelForEach(v.size(), kGrain, [&](size_t k) {
    Vector3d row = Vector3d::Zero();
    if (has_boundary_row(k)) {
      const auto [a, b] = rings_.along_boundary[k];
      row = (v[k] - start_[k]) - 0.5 * ((v[a] - start_[a]) + (v[b] - start_[b]));
    } else if (!rings_.on_boundary[k] && rings_.degree(k) > 0) {
      Vector3d sum = Vector3d::Zero();
      for (uint32_t e = rings_.begin[k]; e < rings_.begin[k + 1]; ++e) sum += v[rings_.to[e]];
      row = v[k] - sum / rings_.degree(k);
    }
    (*rows)[k] = row;
  });
}

double SmoothTerm::Energy(const Positions& v, const SmoothWeights& weights) const {
  Positions rows;
  Umbrella(v, &rows);
  const double surface = ParallelSum(static_cast<int64_t>(v.size()), kGrain, [&](int64_t begin, int64_t end) {
    double sum = 0;
    for (int64_t i = begin; i < end; ++i) {
      const uint32_t k = static_cast<uint32_t>(i);
      if (rings_.on_boundary[k]) {
        sum += 0.5 * weights.boundary * rows[k].squaredNorm();
      } else {
        sum += 0.5 * weights.thin_plate * factor_[k] * rows[k].squaredNorm();
      }
      for (uint32_t e = rings_.begin[k]; e < rings_.begin[k + 1]; ++e) {
        const uint32_t w = rings_.to[e];
        if (!rings_.inner[e] || (rings_.on_boundary[k] && rings_.on_boundary[w])) continue;
        // Each edge occurs twice.
        sum += 0.25 * weights.membrane * EdgeFactor(k, w) * (v[k] - v[w]).squaredNorm() / 6;
      }
    }
    return sum;
  });
  return surface + ParallelSum(static_cast<int64_t>(anchored_.size()), kGrain, [&](int64_t begin, int64_t end) {
           double sum = 0;
           for (int64_t i = begin; i < end; ++i) {
             const Vector3d moved = v[anchored_[i].vertex] - start_[anchored_[i].vertex];
             sum += 0.5 * weights.anchor * moved.dot(anchored_[i].block * moved);
           }
           return sum;
         });
}

void SmoothTerm::Gradient(const Positions& v, const SmoothWeights& weights, Positions* gradient) const {
  Positions rows;
  Umbrella(v, &rows);
  // Weighted rows; a neighbour's share of a row is divided by the degree.
  ParallelForEach(v.size(), kGrain, [&](size_t k) {
    rows[k] *= rings_.on_boundary[k] ? weights.boundary : weights.thin_plate * factor_[k];
  });
  gradient->resize(v.size());
  ParallelForEach(v.size(), kGrain, [&](size_t i) {
    const uint32_t k = static_cast<uint32_t>(i);
    Vector3d sum = Vector3d::Zero(), membrane = Vector3d::Zero();
    if (!fixed_[k]) {
      sum = rows[k];
      for (uint32_t e = rings_.begin[k]; e < rings_.begin[k + 1]; ++e) {
        const uint32_t w = rings_.to[e];
        if (!rings_.on_boundary[w]) sum -= rows[w] / rings_.degree(w);
        if (has_boundary_row(w) && !rings_.inner[e]) sum -= 0.5 * rows[w];
        if (rings_.inner[e] && !(rings_.on_boundary[k] && rings_.on_boundary[w]))
          membrane += EdgeFactor(k, w) / 6 * (v[k] - v[w]);
      }
      sum += weights.membrane * membrane;
    }
    (*gradient)[k] = sum;
  });
  ParallelForEach(anchored_.size(), kGrain, [&](size_t i) {
    const uint32_t k = anchored_[i].vertex;
    (*gradient)[k] += weights.anchor * (anchored_[i].block * (v[k] - start_[k]));
  });
}

}  // namespace tessera
