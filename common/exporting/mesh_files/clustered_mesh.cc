#include "common/exporting/mesh_files/clustered_mesh.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <utility>

namespace tessera {
namespace {

Triangle SortedClusterCorners(Triangle face) {
  std::sort(face.begin(), face.end());
  return face;
}

}  // namespace

Eigen::Vector3d ClusteredMesh::CentreOf(uint32_t cluster) const {
  return cell_m_ * (cells_.positions()[cluster] + Eigen::Vector3d::Constant(0.5));
}

void ClusteredMesh::Add(const Sheet& sheet) {
  colored_ = colored_ && !sheet.colors.empty();
  std::vector<uint32_t> cluster_of;
  cluster_of.reserve(sheet.vertices.size());
  for (const Eigen::Vector3d& p : sheet.vertices) {
    const Eigen::Vector3d cell = (p / cell_m_).array().floor().matrix();
    cluster_of.push_back(cells_.NumberOf(cell));
  }
  clusters_.resize(cells_.positions().size());
  const MeshSpans mesh = sheet.mesh();
  for (size_t f = 0; f < sheet.faces.size(); ++f) {
    const Eigen::Vector3d n = FaceCross(mesh, f);
    ClusterFace face = {{}, sheet.labels[f]};
    for (int k = 0; k < 3; ++k) {
      const uint32_t v = sheet.faces[f][k];
      face.corners[k] = cluster_of[v];
      Cluster& cluster = clusters_[cluster_of[v]];
      const Eigen::Vector3d p = sheet.vertices[v] - CentreOf(cluster_of[v]);
      cluster.matrix += Eigen::Matrix<double, 6, 1>{n.x() * n.x(), n.x() * n.y(), n.x() * n.z(),
                                                    n.y() * n.y(), n.y() * n.z(), n.z() * n.z()};
      cluster.vector += n.dot(p) * n;
      cluster.position_sum += p;
      if (colored_) {
        for (int c = 0; c < 3; ++c) cluster.color_sum[c] += sheet.colors[v][c];
      }
      ++cluster.corners;
    }
    const auto& [a, b, c] = face.corners;
    if (a != b && b != c && c != a) faces_.push_back(face);
  }
}

Eigen::Vector3d ClusteredMesh::PositionOf(uint32_t index) const {
  const Cluster& cluster = clusters_[index];
  const Eigen::Matrix<double, 6, 1>& m = cluster.matrix;
  Eigen::Matrix3d matrix;
  matrix << m[0], m[1], m[2], m[1], m[3], m[4], m[2], m[4], m[5];
  const Eigen::Vector3d mean = cluster.position_sum / std::max(1u, cluster.corners);
  // Directions in which the planes do not fix the point keep the mean.
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(matrix);
  const Eigen::Vector3d rest = cluster.vector - matrix * mean;
  Eigen::Vector3d p = mean;
  for (int k = 0; k < 3; ++k) {
    const double value = solver.eigenvalues()[k];
    const Eigen::Vector3d axis = solver.eigenvectors().col(k);
    if (value > 1e-3 * solver.eigenvalues()[2] && value > 0) p += axis.dot(rest) / value * axis;
  }
  const Eigen::Vector3d half = Eigen::Vector3d::Constant(0.5 * cell_m_);
  if (!p.allFinite()) p = mean;
  return CentreOf(index) + p.cwiseMax(-half).cwiseMin(half);
}

Sheet ClusteredMesh::Take() {
  std::stable_sort(faces_.begin(), faces_.end(), [](const ClusterFace& a, const ClusterFace& b) {
    return SortedClusterCorners(a.corners) < SortedClusterCorners(b.corners);
  });
  const auto same = [](const ClusterFace& a, const ClusterFace& b) {
    return SortedClusterCorners(a.corners) == SortedClusterCorners(b.corners);
  };
  faces_.erase(std::unique(faces_.begin(), faces_.end(), same), faces_.end());
  Sheet out;
  constexpr uint32_t kUnused = ~0u;
  std::vector<uint32_t> number_of(clusters_.size(), kUnused);
  for (const ClusterFace& face : faces_) {
    for (const uint32_t corner : face.corners) {
      if (number_of[corner] != kUnused) continue;
      number_of[corner] = static_cast<uint32_t>(out.vertices.size());
      out.vertices.push_back(PositionOf(corner));
      if (!colored_) continue;
      const Cluster& cluster = clusters_[corner];
      Rgb& color = out.colors.emplace_back();
      for (int c = 0; c < 3; ++c) {
        color[c] = static_cast<uint8_t>((cluster.color_sum[c] + cluster.corners / 2) / cluster.corners);
      }
    }
    const auto& [a, b, c] = face.corners;
    out.faces.push_back({number_of[a], number_of[b], number_of[c]});
    out.labels.push_back(face.label);
  }
  *this = ClusteredMesh(cell_m_);
  return out;
}

}  // namespace tessera
