#include "common/geometry/stray_faces.h"

#include <algorithm>

namespace tessera {
namespace {

constexpr double kFar = 2, kSenseless = 50, kSpikeEdge = 2;  // in units of the extent
constexpr size_t kExtentSamples = 4096;

Eigen::AlignedBox3d BoxOfCentres(std::span<const Viewpoint> views) {
  Eigen::AlignedBox3d box;
  for (const Viewpoint& view : views) box.extend(view.centre);
  return box;
}

double Extent(const MeshSpans& mesh, const Eigen::AlignedBox3d& box) {
  std::vector<double> distances;
  const size_t step = std::max<size_t>(1, mesh.faces.size() / kExtentSamples);
  for (size_t f = 0; f < mesh.faces.size(); f += step) distances.push_back((mesh.Corner(f, 0) - box.center()).norm());
  const auto middle = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
  std::nth_element(distances.begin(), middle, distances.end());
  return std::max(box.diagonal().norm(), *middle);
}

}  // namespace

StrayFaces FindStrayFaces(const MeshSpans& mesh, std::span<const Viewpoint> views, const Eigen::Vector3d& file_origin) {
  StrayFaces out;
  if (views.empty() || mesh.faces.empty()) return out;
  const Eigen::AlignedBox3d box = BoxOfCentres(views);
  const double extent = Extent(mesh, box);
  enum : uint8_t { kNear, kPossibleSpike, kStray };
  const auto is_far = [&](uint32_t v) { return (mesh.vertices[v] - box.center()).norm() > kFar * extent; };
  std::vector<uint8_t> kinds;
  for (size_t v = 0; v < mesh.vertices.size(); ++v) {
    if (!is_far(static_cast<uint32_t>(v))) continue;
    kinds.resize(mesh.vertices.size(), kNear);
    const double distance = (mesh.vertices[v] - box.center()).norm();
    kinds[v] = distance > kSenseless * extent || mesh.vertices[v] == file_origin ? kStray : kPossibleSpike;
  }
  if (kinds.empty()) return out;
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const uint32_t a = mesh.faces[f][k], b = mesh.faces[f][(k + 1) % 3];
      if (kinds[a] != kPossibleSpike && kinds[b] != kPossibleSpike) continue;
      const bool is_long = (mesh.vertices[a] - mesh.vertices[b]).norm() > kSpikeEdge * extent;
      if (is_long && (is_far(a) != is_far(b))) continue;
      for (const uint32_t v : {a, b}) {
        if (kinds[v] == kPossibleSpike) kinds[v] = kNear;
      }
    }
  }
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    bool is_stray = false;
    for (const uint32_t v : mesh.faces[f]) {
      if (kinds[v] == kNear) continue;
      is_stray = true;
      out.vertices.push_back(v);
    }
    if (is_stray) out.faces.push_back(static_cast<uint32_t>(f));
  }
  std::sort(out.vertices.begin(), out.vertices.end());
  out.vertices.erase(std::unique(out.vertices.begin(), out.vertices.end()), out.vertices.end());
  return out;
}

void CollapseStrayFaces(const StrayFaces& stray, std::span<const Viewpoint> views, std::span<Eigen::Vector3d> vertices,
                        std::span<Triangle> faces) {
  for (const uint32_t f : stray.faces) {
    uint32_t kept = faces[f][0];
    for (const uint32_t v : faces[f]) {
      if (std::binary_search(stray.vertices.begin(), stray.vertices.end(), v)) kept = v;
    }
    faces[f] = {kept, kept, kept};
  }
  const Eigen::AlignedBox3d box = BoxOfCentres(views);
  for (const uint32_t v : stray.vertices) vertices[v] = box.center();
}

}  // namespace tessera
