// The triangle mesh as flat arrays.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace tessera {

// Vertex indices of a face, counter-clockwise seen from outside.
using Triangle = std::array<uint32_t, 3>;

// Vertices in metres, usually in the scene's local frame; the owner states the frame.
// `labels`: class index per face, -1: no label; empty if the mesh has no labels.
struct TriangleMesh {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<Triangle> faces;
  std::vector<int32_t> labels;

  const Eigen::Vector3d& Corner(size_t face, int k) const { return vertices[faces[face][k]]; }
};

// A view of a mesh in memory or in a mapped file, which must outlive it.
struct MeshSpans {
  std::span<const Eigen::Vector3d> vertices;
  std::span<const Triangle> faces;
  std::span<const int32_t> labels;

  MeshSpans() = default;
  MeshSpans(const TriangleMesh& mesh) : MeshSpans(mesh.vertices, mesh.faces, mesh.labels) {}
  MeshSpans(std::span<const Eigen::Vector3d> positions, std::span<const Triangle> triangles,
            std::span<const int32_t> face_labels = {})
      : vertices(positions), faces(triangles), labels(face_labels) {}
  const Eigen::Vector3d& Corner(size_t face, int k) const { return vertices[faces[face][k]]; }
  Eigen::Vector3d Centroid(size_t face) const { return (Corner(face, 0) + Corner(face, 1) + Corner(face, 2)) / 3; }
};

// Twice the area times the unit normal of `face`.
inline Eigen::Vector3d FaceCross(const MeshSpans& mesh, size_t face) {
  const Eigen::Vector3d& a = mesh.Corner(face, 0);
  return (mesh.Corner(face, 1) - a).cross(mesh.Corner(face, 2) - a);
}

inline double FaceArea(const MeshSpans& mesh, size_t face) { return 0.5 * FaceCross(mesh, face).norm(); }

// Unit normal; zero for a degenerate face.
inline Eigen::Vector3d FaceNormal(const MeshSpans& mesh, size_t face) {
  return FaceCross(mesh, face).stableNormalized();
}

}  // namespace tessera
