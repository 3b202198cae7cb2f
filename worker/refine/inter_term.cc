#include "worker/refine/inter_term.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <utility>

#include "common/base/parallel.h"
#include "worker/refine/one_rings.h"

namespace tessera {
namespace {

using Eigen::Matrix3f;
using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr int64_t kGrain = 1024;
constexpr double kPi = 3.14159265358979323846;
// Minimum length of a border edge with a defined direction, metres.
constexpr double kMinLength = 1e-9;

struct BorderCorner {
  Vector3d a, b;  // unit vectors to v1 and v2
  double length_a = 0, length_b = 0;
  double sine = 0, cosine = 1;  // of γ
  double delta = 0;             // π - γ
  bool valid = false;
};

BorderCorner TurnAt(const std::vector<Vector3d>& v, const std::array<uint32_t, 3>& corner) {
  BorderCorner turn;
  turn.a = v[corner[1]] - v[corner[0]];
  turn.b = v[corner[2]] - v[corner[0]];
  turn.length_a = turn.a.norm();
  turn.length_b = turn.b.norm();
  turn.valid = turn.length_a > kMinLength && turn.length_b > kMinLength;
  if (!turn.valid) return turn;
  turn.a /= turn.length_a;
  turn.b /= turn.length_b;
  turn.sine = turn.a.cross(turn.b).norm();
  turn.cosine = turn.a.dot(turn.b);
  turn.delta = std::atan2(turn.sine, -turn.cosine);
  return turn;
}

// dE/dv1 and dE/dv2.
std::pair<Vector3d, Vector3d> EndDerivatives(const BorderCorner& turn) {
  if (!turn.valid) return {Vector3d::Zero(), Vector3d::Zero()};
  // b - cosγ a has length sinγ: the product stays below 2π although k has a pole at γ = 0.
  constexpr double kMinSine = 1e-9;
  double k = 2;
  if (turn.sine > kMinSine) {
    k = 2 * turn.delta / turn.sine;
  } else if (turn.cosine > 0) {
    k = 2 * turn.delta / kMinSine;
  }
  return {k / turn.length_a * (turn.b - turn.cosine * turn.a), k / turn.length_b * (turn.a - turn.cosine * turn.b)};
}

bool Unlabelled(int32_t label) { return label < 0 || label == 255; }

// The ends of the two border edges at v, if its faces form one closed fan with two label changes.
std::optional<std::array<uint32_t, 2>> BorderEnds(uint32_t v, std::span<const uint32_t> faces_at,
                                                  const std::vector<Triangle>& faces,
                                                  const std::vector<int32_t>& labels) {
  // Of a face at v: the vertex after v, the vertex before it, and the label.
  const auto after = [&](uint32_t f) { return faces[f][faces[f][0] == v ? 1 : faces[f][1] == v ? 2 : 0]; };
  const auto before = [&](uint32_t f) { return faces[f][faces[f][0] == v ? 2 : faces[f][1] == v ? 0 : 1]; };
  std::array<uint32_t, 2> ends;
  int changes = 0;
  uint32_t face = faces_at[0];
  for (size_t step = 0; step < faces_at.size(); ++step) {
    const uint32_t edge_end = before(face);
    std::optional<uint32_t> next;
    for (uint32_t g : faces_at) {
      if (after(g) != edge_end) continue;
      if (next) return std::nullopt;  // not a manifold
      next = g;
    }
    if (!next) return std::nullopt;  // a boundary vertex
    if (labels[*next] != labels[face]) {
      if (changes == 2) return std::nullopt;
      ends[changes++] = edge_end;
    }
    face = *next;
    // The fan closes early: the faces at v form several fans.
    if ((face == faces_at[0]) != (step + 1 == faces_at.size())) return std::nullopt;
  }
  if (changes != 2) return std::nullopt;
  if (ends[0] > ends[1]) std::swap(ends[0], ends[1]);
  return ends;
}

}  // namespace

Matrix3f InterCurvature::Corner::Block(uint32_t role) const {
  const Matrix3f across_a = inverse_a * (Matrix3f::Identity() - a * a.transpose());
  const Matrix3f across_b = inverse_b * (Matrix3f::Identity() - b * b.transpose());
  if (role == 1) return weight * (inverse_a * across_a);
  if (role == 2) return weight * (inverse_b * across_b);
  const Matrix3f both = across_a + across_b;
  return weight * (both.transpose() * both);
}

InterTerm::InterTerm(const TriangleMesh& mesh, const std::vector<uint8_t>& fixed)
    : faces_(mesh.faces), fixed_(fixed), faces_of_vertex_(FacesOfVertices(mesh)) {
  if (fixed_.empty()) fixed_.assign(mesh.vertices.size(), 0);
}

void InterTerm::SetLabels(const std::vector<int32_t>& labels) {
  corners_.clear();
  incidence_ = {};
  if (labels.empty()) return;
  for (uint32_t v = 0; v < fixed_.size(); ++v) {
    const std::span<const uint32_t> at = faces_of_vertex_[v];
    bool several = false, unlabelled = false;
    for (uint32_t f : at) {
      several |= labels[f] != labels[at[0]];
      unlabelled |= Unlabelled(labels[f]);
    }
    if (!several || unlabelled) continue;
    if (const auto ends = BorderEnds(v, at, faces_, labels)) corners_.push_back({v, (*ends)[0], (*ends)[1]});
  }

  std::vector<std::pair<uint32_t, uint32_t>> touched;  // vertex, entry
  for (size_t c = 0; c < corners_.size(); ++c) {
    for (uint32_t role = 0; role < 3; ++role) {
      const uint32_t v = corners_[c][role];
      if (!fixed_[v]) touched.emplace_back(v, static_cast<uint32_t>(3 * c + role));
    }
  }
  std::sort(touched.begin(), touched.end());
  for (const auto& [v, entry] : touched) {
    if (incidence_.vertices.empty() || incidence_.vertices.back() != v) {
      incidence_.vertices.push_back(v);
      incidence_.begin.push_back(static_cast<uint32_t>(incidence_.entries.size()));
    }
    incidence_.entries.push_back(entry);
  }
  incidence_.begin.push_back(static_cast<uint32_t>(incidence_.entries.size()));
}

double InterTerm::Energy(const Positions& v, const std::vector<float>& pairs) const {
  return ParallelSum(static_cast<int64_t>(corners_.size()), kGrain, [&](int64_t begin, int64_t end) {
    double sum = 0;
    for (int64_t c = begin; c < end; ++c) {
      const double delta = Counts(c, pairs) ? TurnAt(v, corners_[c]).delta : 0;
      sum += delta * delta;
    }
    return sum;
  });
}

void InterTerm::AddGradient(const Positions& v, double weight, const std::vector<float>& pairs,
                            Positions* gradient) const {
  std::vector<std::pair<Vector3d, Vector3d>> derivatives(corners_.size());
  ParallelForEach(corners_.size(), kGrain, [&](int64_t c) {
    derivatives[c] = Counts(c, pairs) ? EndDerivatives(TurnAt(v, corners_[c])) : EndDerivatives(BorderCorner());
  });
  ParallelForEach(incidence_.vertices.size(), kGrain, [&](int64_t i) {
    Vector3d sum = Vector3d::Zero();
    for (uint32_t e = incidence_.begin[i]; e < incidence_.begin[i + 1]; ++e) {
      const auto& [at1, at2] = derivatives[incidence_.entries[e] / 3];
      const uint32_t role = incidence_.entries[e] % 3;
      if (role == 0) {
        sum -= at1 + at2;
      } else {
        sum += role == 1 ? at1 : at2;
      }
    }
    (*gradient)[incidence_.vertices[i]] += weight * sum;
  });
}

InterCurvature InterTerm::Curvature(const Positions& v, double weight, const std::vector<float>& pairs) const {
  InterCurvature out;
  out.incidence = incidence_;
  out.corners.resize(corners_.size());
  ParallelForEach(corners_.size(), kGrain, [&](int64_t c) {
    InterCurvature::Corner& corner = out.corners[c];
    corner.vertex = corners_[c];
    const BorderCorner turn = Counts(c, pairs) ? TurnAt(v, corners_[c]) : BorderCorner();
    if (!turn.valid) {
      corner.a = corner.b = Vector3f::Zero();
      return;
    }
    corner.a = turn.a.cast<float>();
    corner.b = turn.b.cast<float>();
    corner.inverse_a = static_cast<float>(1 / turn.length_a);
    corner.inverse_b = static_cast<float>(1 / turn.length_b);
    constexpr double kMinShare = 1.0 / 8;
    corner.weight = static_cast<float>(weight * 4 / std::max(1 - turn.cosine, 2 * kMinShare));
  });
  return out;
}

}  // namespace tessera
