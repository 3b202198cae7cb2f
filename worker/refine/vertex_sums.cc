#include "worker/refine/vertex_sums.h"

#include <algorithm>
#include <cstdint>

#include "common/base/parallel.h"
#include "worker/refine/one_rings.h"

namespace tessera {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int64_t kGrain = 2048;

}  // namespace

PhotoDerivatives GatherVertices(const MeshSpans& mesh, const CsrRows& faces_of_vertex,
                                const std::vector<FaceSums>& sums, const ContourSums& contours) {
  std::vector<Vector3d> normals(mesh.faces.size());
  ParallelForEach(normals.size(), kGrain, [&](size_t f) { normals[f] = FaceNormal(mesh, f); });
  std::vector<int32_t> contour_of_face;  // -1: none
  if (!contours.faces.empty()) {
    contour_of_face.assign(mesh.faces.size(), -1);
    ParallelForEach(contours.faces.size(), kGrain,
                    [&](size_t i) { contour_of_face[contours.faces[i].face] = static_cast<int32_t>(i); });
  }
  const size_t n = mesh.vertices.size();
  PhotoDerivatives out;
  out.gradient.resize(n);
  out.curvature.resize(n);
  out.pairs.resize(n);
  const auto gather = [&](size_t v, std::vector<int32_t>* buffer) {
    Vector3d gradient = Vector3d::Zero();
    Matrix3d curvature = Matrix3d::Zero();
    float pairs = 0, seen_faces = 0;
    for (const uint32_t f : faces_of_vertex[v]) {
      const FaceSums& face = sums[f];
      if (face.pairs == 0) continue;
      const int c = CornerOf(mesh.faces[f], v);
      const Vector3d& normal = normals[f];
      gradient += static_cast<double>(face.gradient[c]) * normal;
      curvature.noalias() += (static_cast<double>(face.curvature[c]) * normal) * normal.transpose();
      pairs += face.pairs;
      seen_faces += 1;
    }
    if (seen_faces > 0) pairs /= seen_faces;
    const double scale = 1 / std::max(1.0, static_cast<double>(pairs));
    out.gradient[v] = scale * gradient;
    out.curvature[v] = scale * curvature;
    out.pairs[v] = pairs;
    if (contour_of_face.empty()) return;
    Vector3d pull = Vector3d::Zero();
    Matrix3d stiffness = Matrix3d::Zero();
    std::vector<int32_t>& views = *buffer;
    views.clear();
    for (const uint32_t f : faces_of_vertex[v]) {
      if (contour_of_face[f] < 0) continue;
      const FaceContour& contour = contours.faces[contour_of_face[f]];
      const int c = CornerOf(mesh.faces[f], v);
      pull += contour.gradient[c];
      stiffness += contour.Curvature(c);
      views.insert(views.end(), contours.views.begin() + contour.views_begin,
                   contours.views.begin() + contour.views_end);
    }
    std::sort(views.begin(), views.end());
    const auto count = std::unique(views.begin(), views.end()) - views.begin();
    if (count == 0) return;
    out.gradient[v] += pull / static_cast<double>(count);
    out.curvature[v] += stiffness / static_cast<double>(count);
  };
  ParallelFor(static_cast<int64_t>(n), kGrain, [&](int64_t begin, int64_t end) {
    std::vector<int32_t> views;
    for (int64_t v = begin; v < end; ++v) gather(static_cast<size_t>(v), &views);
  });
  return out;
}

}  // namespace tessera
