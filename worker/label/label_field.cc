#include "worker/label/label_field.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "common/base/loops/indices_where.h"
#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr int64_t kGrain = 4096;
constexpr double kFaceAreaGsd2 = 12;  // A0 in GSD²: the typical face area after subdivision

bool ViolatesPrior(const SceneClass& c, double angle_rad) {
  return std::abs(angle_rad - c.prior_beta_rad) > c.prior_alpha_rad;
}

}  // namespace

LabelField BuildLabelField(const MeshSpans& mesh, const std::vector<MeshEdge>& edges,
                           const FaceLikelihoods& likelihoods, const std::vector<SceneClass>& classes,
                           const Eigen::Vector3d& up, double gsd_m, const LabelOptions& options) {
  const bool paper = options.form == LabelOptions::Form::kPaper;
  const double unit_area_m2 = kFaceAreaGsd2 * gsd_m * gsd_m;
  const double unit_edge_m = std::sqrt(4 * unit_area_m2 / std::sqrt(3.0));
  const int class_count = static_cast<int>(classes.size());
  const int64_t face_count = static_cast<int64_t>(mesh.faces.size());

  LabelField field;
  field.classes = class_count;
  field.unary.resize(face_count * class_count);
  ParallelForEach(face_count, kGrain, [&](int64_t f) {
    const Eigen::Vector3d cross = FaceCross(mesh, f);
    const double area_m2 = 0.5 * cross.norm();
    const double angle_rad = std::acos(std::clamp(cross.stableNormalized().dot(up), -1.0, 1.0));
    const double pixels = likelihoods.pixels[f];
    const double data_weight = paper ? 1 : area_m2 / unit_area_m2;
    const double unsure = options.unsure_pixels * area_m2 / unit_area_m2;
    const double prior_weight = options.prior_weight * (paper ? area_m2 : area_m2 / unit_area_m2);
    for (int l = 0; l < class_count; ++l) {
      const double sum = likelihoods.sum[f * class_count + l];
      const double p = paper ? sum : (sum + unsure) / (pixels + unsure);
      const double data = pixels > 0 ? -std::log(std::max(p, options.floor)) : 0;
      const double prior = ViolatesPrior(classes[l], angle_rad) ? prior_weight : 0;
      field.unary[f * class_count + l] = static_cast<float>(data_weight * data + prior);
    }
  });

  const std::vector<uint32_t> inner = IndicesWhere(edges.size(), kGrain, [&](uint32_t e) {
    return edges[e].left >= 0 && edges[e].right >= 0 && edges[e].left != edges[e].right;
  });
  field.edges.resize(inner.size());
  ParallelForEach(inner.size(), kGrain, [&](size_t i) {
    const MeshEdge& edge = edges[inner[i]];
    const double weight = paper ? FaceArea(mesh, edge.left) + FaceArea(mesh, edge.right)
                                : (mesh.vertices[edge.a] - mesh.vertices[edge.b]).norm() / unit_edge_m;
    field.edges[i] = {static_cast<uint32_t>(edge.left), static_cast<uint32_t>(edge.right),
                      static_cast<float>(options.smoothness_weight * weight)};
  });
  return field;
}

FieldGraph MakeFieldGraph(const LabelField& field) {
  FieldGraph graph;
  graph.offsets.assign(field.faces() + 1, 0);
  for (const FieldEdge& e : field.edges) {
    if (e.weight == 0) continue;
    ++graph.offsets[e.face0];
    ++graph.offsets[e.face1];
  }
  // Offsets first hold the end of each face's links; filling backwards turns them into the begin.
  std::partial_sum(graph.offsets.begin(), graph.offsets.end(), graph.offsets.begin());
  graph.links.resize(graph.offsets.back());
  for (uint32_t i = static_cast<uint32_t>(field.edges.size()); i-- > 0;) {
    const FieldEdge& e = field.edges[i];
    if (e.weight == 0) continue;
    graph.links[--graph.offsets[e.face0]] = {e.face1, e.weight, i};
    graph.links[--graph.offsets[e.face1]] = {e.face0, e.weight, i};
  }
  return graph;
}

}  // namespace tessera
