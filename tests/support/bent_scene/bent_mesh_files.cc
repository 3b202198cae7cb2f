// Mesh files as other programs write them.
#include <cmath>
#include <map>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "tests/support/bent_scene/bent_scene.h"
#include "tests/support/bent_scene/raw_bytes.h"
#include "tests/support/bent_scene/scene_mesh_file.h"
#include "tests/support/bent_scene/text_model.h"
#include "tests/support/quad_mesh.h"
#include "tests/support/tiny_scene.h"

namespace tessera::bent {
namespace {

// A PLY header: `lines` without its first and last one.
std::string PlyHeaderText(const std::vector<std::string>& lines) {
  std::string header = "ply\n";
  for (const std::string& line : lines) absl::StrAppend(&header, line, "\n");
  return header + "end_header\n";
}

// A binary little-endian PLY with coordinates and labels of types that WritePly does not write.
template <class Coordinate, class Label>
std::string BinaryPly(const TriangleMesh& mesh, const std::string& coordinate_type, const std::string& label_type) {
  std::string bytes =
      PlyHeaderText({"format binary_little_endian 1.0", absl::StrCat("element vertex ", mesh.vertices.size()),
                     absl::StrCat("property ", coordinate_type, " x"), absl::StrCat("property ", coordinate_type, " y"),
                     absl::StrCat("property ", coordinate_type, " z"), absl::StrCat("element face ", mesh.faces.size()),
                     "property list uchar int vertex_indices", absl::StrCat("property ", label_type, " label")});
  for (const Eigen::Vector3d& p : mesh.vertices) {
    for (int k = 0; k < 3; ++k) bytes += Raw<Coordinate>({static_cast<Coordinate>(p[k])});
  }
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const Triangle& face = mesh.faces[f];
    bytes += '\3' + Raw<uint32_t>({face[0], face[1], face[2]}) + Raw<Label>({static_cast<Label>(mesh.labels[f])});
  }
  return bytes;
}

size_t HeaderBytes(const std::string& ply) {
  const std::string end = "end_header\n";
  return ply.find(end) + end.size();
}

// The mesh as quads (a, b, c, d), each of two faces (a, b, c) and (a, c, d) of one label, and the faces that are left.
std::vector<std::vector<uint32_t>> QuadsOf(const TriangleMesh& mesh, std::vector<int32_t>* labels) {
  std::map<std::pair<uint32_t, uint32_t>, size_t> face_of_edge;  // by its directed edges
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    for (int k = 0; k < 3; ++k) face_of_edge[{mesh.faces[f][k], mesh.faces[f][(k + 1) % 3]}] = f;
  }
  std::vector<std::vector<uint32_t>> polygons;
  std::vector<bool> used(mesh.faces.size());
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    if (used[f]) continue;
    const Triangle& face = mesh.faces[f];
    std::vector<uint32_t> polygon(face.begin(), face.end());
    for (int k = 0; k < 3; ++k) {
      const uint32_t a = face[k], b = face[(k + 1) % 3], c = face[(k + 2) % 3];  // (a, c) is the common edge
      const auto other = face_of_edge.find({a, c});
      if (other == face_of_edge.end() || other->second <= f || used[other->second]) continue;
      if (mesh.labels[other->second] != mesh.labels[f]) continue;
      const Triangle& second = mesh.faces[other->second];
      for (const uint32_t v : second) {
        if (v != a && v != c) polygon = {a, b, c, v};
      }
      used[other->second] = true;
      break;
    }
    used[f] = true;
    polygons.push_back(polygon);
    labels->push_back(mesh.labels[f]);
  }
  return polygons;
}

}  // namespace

void LabelsOnVertices(const std::string& scene) {
  WriteText(scene + "/mesh.ply", VertexLabelPly(ReadSceneMesh(scene)));
  DropLikelihoods(scene);
}

void LabelAsFloat(const std::string& scene) {
  WriteText(scene + "/mesh.ply", BinaryPly<double, float>(ReadSceneMesh(scene), "double", "float"));
}

void Quads(const std::string& scene) {
  const TriangleMesh mesh = ReadSceneMesh(scene);
  std::vector<int32_t> labels;
  const std::vector<std::vector<uint32_t>> polygons = QuadsOf(mesh, &labels);
  std::string ply =
      PlyHeaderText({"format ascii 1.0", absl::StrCat("element vertex ", mesh.vertices.size()), "property double x",
                     "property double y", "property double z", absl::StrCat("element face ", polygons.size()),
                     "property list uchar int vertex_indices", "property int label"});
  for (const Eigen::Vector3d& p : mesh.vertices) absl::StrAppend(&ply, PositionLine(p), "\n");
  for (size_t i = 0; i < polygons.size(); ++i) {
    absl::StrAppend(&ply, polygons[i].size());
    for (const uint32_t v : polygons[i]) absl::StrAppend(&ply, " ", v);
    absl::StrAppend(&ply, " ", labels[i], "\n");
  }
  WriteText(scene + "/mesh.ply", ply);
}

void OneFaceShort(const std::string& scene) {
  const size_t faces = ReadSceneMesh(scene).faces.size();
  ReplaceInFile(scene + "/mesh.ply", absl::StrCat("element face ", faces), absl::StrCat("element face ", faces + 1));
}

void CrlfBinaryHeader(const std::string& scene) {
  const std::string ply = ReadText(scene + "/mesh.ply");
  const size_t header = HeaderBytes(ply);
  WriteText(scene + "/mesh.ply", absl::StrReplaceAll(ply.substr(0, header), {{"\n", "\r\n"}}) + ply.substr(header));
}

void BigEndianHeaderExtras(const std::string& scene) {
  const TriangleMesh mesh = ReadSceneMesh(scene);
  std::string ply = PlyHeaderText({"format binary_big_endian 1.0",
                                   "comment VCGLIB generated",
                                   "comment TextureFile a.png",
                                   "obj_info num_cols 3",
                                   "element camera 1",
                                   "property float view_px",
                                   "property int viewportx",
                                   absl::StrCat("element face ", mesh.faces.size()),
                                   "property list uchar float texcoord",
                                   "property list uint uint vertex_index",
                                   "property uchar red",
                                   "property short label",
                                   absl::StrCat("element vertex ", mesh.vertices.size()),
                                   "property float nx",
                                   "property double x",
                                   "property double y",
                                   "property double z",
                                   "property list uchar uint view_indices",
                                   "property float quality",
                                   "element multi_texture_vertex 2",
                                   "property uchar tx",
                                   "property float u",
                                   "property float v"});
  ply += RawBigEndian(1.0f) + RawBigEndian(int32_t{2});
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    ply += '\6';
    for (int k = 0; k < 6; ++k) ply += RawBigEndian(0.5f);
    ply += RawBigEndian(uint32_t{3});
    for (const uint32_t v : mesh.faces[f]) ply += RawBigEndian(v);
    ply += '\7' + RawBigEndian(static_cast<int16_t>(mesh.labels[f]));
  }
  for (const Eigen::Vector3d& p : mesh.vertices) {
    ply += RawBigEndian(0.0f);
    for (int k = 0; k < 3; ++k) ply += RawBigEndian(p[k]);
    ply += '\2' + RawBigEndian(uint32_t{1}) + RawBigEndian(uint32_t{2}) + RawBigEndian(1.0f);
  }
  ply += std::string(2 * 9, '\0');
  WriteText(scene + "/mesh.ply", ply);
}

void FloatUtm(const std::string& scene) {
  DoubleUtm(scene);
  WriteText(scene + "/mesh.ply", BinaryPly<float, int32_t>(ReadSceneMesh(scene), "float", "int"));
}

void NanVertex(const std::string& scene) {
  TriangleMesh mesh = ReadSceneMesh(scene);
  mesh.vertices.at(17).z() = NAN;
  WriteText(scene + "/mesh.ply", BinaryPly<double, int32_t>(mesh, "double", "int"));
}

void PointCloud(const std::string& scene) {
  const TriangleMesh mesh = ReadSceneMesh(scene);
  std::string ply = PlyHeaderText({"format ascii 1.0", absl::StrCat("element vertex ", mesh.vertices.size()),
                                   "property float x", "property float y", "property float z", "property uchar red"});
  for (const Eigen::Vector3d& p : mesh.vertices) absl::StrAppend(&ply, PositionLine(p), " 3\n");
  WriteText(scene + "/mesh.ply", ply);
}

void ObjCalledPly(const std::string& scene) {
  const TriangleMesh mesh = ReadSceneMesh(scene);
  std::string obj = "# obj\n";
  for (const Eigen::Vector3d& p : mesh.vertices) absl::StrAppend(&obj, "v ", PositionLine(p), "\n");
  for (const Triangle& face : mesh.faces) {
    absl::StrAppend(&obj, "f ", face[0] + 1, " ", face[1] + 1, " ", face[2] + 1, "\n");
  }
  WriteText(scene + "/mesh.ply", obj);
}

}  // namespace tessera::bent
