// The mesh of the tiny scene, whose triangles come in pairs, as other programs write it.
#pragma once

#include <array>
#include <cstdint>
#include <cstdio>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/geometry/mesh.h"

namespace tessera {

// Calls `add` with the four vertices and the first triangle of each quad.
template <class Add>
void ForEachQuad(const TriangleMesh& mesh, const Add& add) {
  for (size_t f = 0; f + 1 < mesh.faces.size(); f += 2) {
    const Triangle& a = mesh.faces[f];
    add(std::array<uint32_t, 4>{a[0], a[1], a[2], mesh.faces[f + 1][2]}, f);
  }
}

inline std::string PositionLine(const Eigen::Vector3d& p) {
  char line[128];
  std::snprintf(line, sizeof line, "%.17g %.17g %.17g", p.x(), p.y(), p.z());
  return line;
}

// Text PLY of quads, with labels as floats in the property `category_id`.
inline std::string QuadPly(const TriangleMesh& mesh) {
  std::string ply = absl::StrCat("ply\nformat ascii 1.0\nelement vertex ", mesh.vertices.size(),
                                 "\nproperty double x\nproperty double y\nproperty double z\nelement face ",
                                 mesh.faces.size() / 2, "\nproperty list uchar int vertex_indices\n",
                                 mesh.labels.empty() ? "" : "property float category_id\n", "end_header\n");
  for (const Eigen::Vector3d& p : mesh.vertices) absl::StrAppend(&ply, PositionLine(p), "\n");
  ForEachQuad(mesh, [&](const std::array<uint32_t, 4>& v, size_t f) {
    absl::StrAppend(&ply, "4 ", v[0], " ", v[1], " ", v[2], " ", v[3]);
    if (!mesh.labels.empty()) absl::StrAppend(&ply, " ", mesh.labels[f], ".000000");
    ply += "\n";
  });
  return ply;
}

// Text PLY of triangles, with labels of vertices: each has the label of the last face that it belongs to.
inline std::string VertexLabelPly(const TriangleMesh& mesh) {
  std::vector<int32_t> labels(mesh.vertices.size(), -1);
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    for (const uint32_t v : mesh.faces[f]) labels[v] = mesh.labels[f];
  }
  std::string ply = absl::StrCat("ply\nformat ascii 1.0\nelement vertex ", mesh.vertices.size(),
                                 "\nproperty double x\nproperty double y\nproperty double z\n"
                                 "property float scalar_Label\nelement face ",
                                 mesh.faces.size(), "\nproperty list uchar int vertex_indices\nend_header\n");
  for (size_t v = 0; v < labels.size(); ++v) {
    absl::StrAppend(&ply, PositionLine(mesh.vertices[v]), " ", labels[v], ".0\n");
  }
  for (const Triangle& face : mesh.faces) absl::StrAppend(&ply, "3 ", face[0], " ", face[1], " ", face[2], "\n");
  return ply;
}

// OBJ of quads, with normals and a material; no labels.
inline std::string QuadObj(const TriangleMesh& mesh) {
  std::string obj = "# quads\nmtllib a.mtl\no city\n";
  for (const Eigen::Vector3d& p : mesh.vertices) absl::StrAppend(&obj, "v ", PositionLine(p), "\n");
  obj += "vn 0 0 1\nusemtl wall\n";
  ForEachQuad(mesh, [&](const std::array<uint32_t, 4>& v, size_t) {
    absl::StrAppend(&obj, "f ", v[0] + 1, "//1 ", v[1] + 1, "//1 ", v[2] + 1, "//1 ", v[3] + 1, "//1\n");
  });
  return obj;
}

}  // namespace tessera
