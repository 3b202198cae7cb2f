#include "common/geometry/simplify.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "common/geometry/nearest_surface.h"

namespace tessera {
namespace {

// The library's errors are means over areas, not maxima: the aim lies below the tolerance, and what still fails is kept
// in full in the next round.
constexpr double kAim = 0.5;
constexpr double kBetweenSamples = 0.8;  // of the tolerance at samples, for what lies between them
constexpr int kRounds = 6;

std::vector<uint32_t> CornersOf(const std::vector<Triangle>& faces) {
  std::vector<uint32_t> corners;
  corners.reserve(3 * faces.size());
  for (const Triangle& face : faces) corners.insert(corners.end(), face.begin(), face.end());
  return corners;
}

// Relative to the middle, or floats would cost a city far from the origin its millimetres.
std::vector<float> CentredPositions(const TriangleMesh& mesh) {
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& p : mesh.vertices) box.extend(p);
  const Eigen::Vector3d centre = box.center();
  std::vector<float> positions;
  positions.reserve(3 * mesh.vertices.size());
  for (const Eigen::Vector3d& p : mesh.vertices) {
    for (int k = 0; k < 3; ++k) positions.push_back(static_cast<float>(p[k] - centre[k]));
  }
  return positions;
}

double MeanEdge(const TriangleMesh& mesh) {
  double sum = 0;
  for (const Triangle& face : mesh.faces) {
    for (int k = 0; k < 3; ++k) sum += (mesh.vertices[face[(k + 1) % 3]] - mesh.vertices[face[k]]).norm();
  }
  return sum / (3.0 * static_cast<double>(std::max<size_t>(mesh.faces.size(), 1)));
}

TriangleMesh WithoutUnusedVertices(const TriangleMesh& mesh, const std::vector<uint32_t>& corners) {
  constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();
  std::vector<uint32_t> index(mesh.vertices.size(), kNone);
  for (const uint32_t v : corners) index[v] = 0;
  TriangleMesh out;
  for (size_t v = 0; v < index.size(); ++v) {
    if (index[v] == kNone) continue;
    index[v] = static_cast<uint32_t>(out.vertices.size());
    out.vertices.push_back(mesh.vertices[v]);
  }
  out.faces.reserve(corners.size() / 3);
  for (size_t i = 0; i + 2 < corners.size(); i += 3) {
    out.faces.push_back({index[corners[i]], index[corners[i + 1]], index[corners[i + 2]]});
  }
  return out;
}

// Marks the vertices that are farther than `tolerance_m` from the surface; whether there are any.
bool MarkFarVertices(const TriangleMesh& mesh, const NearestSurface& surface, double tolerance_m,
                     std::vector<uint8_t>* far) {
  bool any = false;
  for (size_t v = 0; v < mesh.vertices.size(); ++v) {
    if (surface.IsWithin(mesh.vertices[v], tolerance_m)) continue;
    (*far)[v] = any = true;
  }
  return any;
}

// Samples the faces of `simple`, no farther apart than `spacing_m` along a face's sides, and marks the vertices of the
// faces of `input` that far samples are nearest to; whether there are any.
bool MarkFarFaces(const TriangleMesh& simple, const TriangleMesh& input, const NearestSurface& surface,
                  double spacing_m, double tolerance_m, std::vector<uint8_t>* far) {
  bool any = false;
  for (size_t f = 0; f < simple.faces.size(); ++f) {
    const Eigen::Vector3d &a = simple.Corner(f, 0), &b = simple.Corner(f, 1), &c = simple.Corner(f, 2);
    const double longest_m = std::sqrt(std::max({(b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm()}));
    const int steps = std::max(1, static_cast<int>(std::ceil(longest_m / spacing_m)));
    for (int i = 0; i <= steps; ++i) {
      for (int j = 0; i + j <= steps; ++j) {
        if (i == steps || j == steps || i + j == 0) continue;  // corners are the input's
        const Eigen::Vector3d p = a + (i * (b - a) + j * (c - a)) / steps;
        if (surface.IsWithin(p, tolerance_m)) continue;
        const NearestPoint nearest = surface.Find(p);
        any = true;
        for (const uint32_t v : input.faces[nearest.face]) (*far)[v] = 1;
      }
    }
  }
  return any;
}

}  // namespace

TriangleMesh SimplifyMesh(const TriangleMesh& mesh, double tolerance_m) {
  const TriangleMesh input = WithoutUnusedVertices(mesh, CornersOf(mesh.faces));
  if (input.faces.empty() || !(tolerance_m > 0)) return input;
  constexpr size_t kStride = 3 * sizeof(float);
  const std::vector<float> positions = CentredPositions(input);
  const double scale_m = meshopt_simplifyScale(positions.data(), input.vertices.size(), kStride);
  const double spacing_m = MeanEdge(input), sample_tolerance_m = kBetweenSamples * tolerance_m;
  if (!(scale_m > 0) || !(spacing_m > 0)) return input;
  const float error = static_cast<float>(kAim * tolerance_m / scale_m);
  const NearestSurface input_surface(input);
  std::vector<uint8_t> far(input.vertices.size(), 0);
  for (int round = 0; round < kRounds; ++round) {
    std::vector<Triangle> open, kept;
    for (const Triangle& face : input.faces)
      (far[face[0]] || far[face[1]] || far[face[2]] ? kept : open).push_back(face);
    const std::vector<uint32_t> corners = CornersOf(open), kept_corners = CornersOf(kept);
    std::vector<uint32_t> fewer(corners.size());
    fewer.resize(meshopt_simplify(fewer.data(), corners.data(), corners.size(), positions.data(), input.vertices.size(),
                                  kStride, 0, error, meshopt_SimplifyLockBorder, nullptr));
    fewer.insert(fewer.end(), kept_corners.begin(), kept_corners.end());
    if (fewer.empty()) break;
    TriangleMesh simple = WithoutUnusedVertices(input, fewer);
    const bool far_vertices = MarkFarVertices(input, NearestSurface(simple), sample_tolerance_m, &far);
    const bool far_faces = MarkFarFaces(simple, input, input_surface, spacing_m, sample_tolerance_m, &far);
    if (!far_vertices && !far_faces) return simple;
  }
  return input;
}

}  // namespace tessera
