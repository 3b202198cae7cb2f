#include "common/exporting/tiles3d/tiles3d_part.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "common/arrays/array_file.h"
#include "common/geometry/position_index.h"

namespace tessera {
namespace {

template <class T, class Three>
std::vector<T> FlatTiles3d(const std::vector<Three>& values) {
  std::vector<T> flat;
  flat.reserve(3 * values.size());
  for (const Three& value : values) flat.insert(flat.end(), {value[0], value[1], value[2]});
  return flat;
}

// Takes an array of groups of three.
template <class Three, class T>
StatusOr<std::vector<Three>> TakeThrees(ArrayFile* file, const std::string& name) {
  TESSERA_ASSIGN_OR_RETURN(const std::vector<T> flat, file->Take<T>(name));
  if (flat.size() % 3 != 0) return absl::DataLossError(file->name + ": " + name + ": expected groups of three values");
  std::vector<Three> values(flat.size() / 3);
  for (size_t i = 0; i < flat.size(); ++i) values[i / 3][i % 3] = flat[i];
  return values;
}

template <class T>
void AppendTiles3d(const std::vector<T>& from, std::vector<T>* to) {
  to->insert(to->end(), from.begin(), from.end());
}

}  // namespace

Status WriteTiles3dParts(const std::string& path, const std::vector<Tiles3dPart>& parts) {
  ArrayFile file;
  for (const Tiles3dPart& part : parts) {
    if (part.mesh.faces.size() == 0) continue;
    const Tiles3dVertices& vertices = part.mesh.vertices;
    const auto put = [&](const char* name, ArrayData data) {
      file.arrays[absl::StrCat(part.set, ".", name)] = std::move(data);
    };
    put("positions", FlatTiles3d<double>(vertices.positions));
    put("normals", FlatTiles3d<float>(vertices.normals));
    put("confidence", vertices.confidence);
    put("displacement_m", vertices.displacement_m);
    put("colors", FlatTiles3d<uint8_t>(vertices.colors));
    put("shared", vertices.shared);
    put("faces", FlatTiles3d<uint32_t>(part.mesh.faces.corners));
    put("labels", part.mesh.faces.labels);
    std::vector<double> samples;
    std::vector<uint32_t> sample_faces;
    for (const Tiles3dPoint& point : part.samples) {
      samples.insert(samples.end(), point.position.begin(), point.position.end());
      sample_faces.push_back(point.face);
    }
    put("samples", std::move(samples));
    put("sample_faces", std::move(sample_faces));
    std::vector<double> tile = {part.error_m, part.samples_error_m};
    for (const Eigen::Vector3d& corner : {part.box.min(), part.box.max()})
      tile.insert(tile.end(), corner.begin(), corner.end());
    put("tile", std::move(tile));
  }
  return WriteArrayFile(path, file);
}

StatusOr<Tiles3dPart> ReadTiles3dPart(const std::string& path, const std::string& set) {
  TESSERA_ASSIGN_OR_RETURN(ArrayFile file, ReadArrayFile(path));
  Tiles3dPart part;
  part.set = set;
  if (!file.arrays.contains(set + ".faces")) return part;
  Tiles3dVertices& vertices = part.mesh.vertices;
  TESSERA_ASSIGN_OR_RETURN(vertices.positions, (TakeThrees<Eigen::Vector3d, double>(&file, set + ".positions")));
  TESSERA_ASSIGN_OR_RETURN(vertices.normals, (TakeThrees<Eigen::Vector3f, float>(&file, set + ".normals")));
  TESSERA_ASSIGN_OR_RETURN(vertices.confidence, file.Take<float>(set + ".confidence"));
  TESSERA_ASSIGN_OR_RETURN(vertices.displacement_m, file.Take<float>(set + ".displacement_m"));
  TESSERA_ASSIGN_OR_RETURN(vertices.colors, (TakeThrees<Rgb, uint8_t>(&file, set + ".colors")));
  TESSERA_ASSIGN_OR_RETURN(vertices.shared, file.Take<uint8_t>(set + ".shared"));
  TESSERA_ASSIGN_OR_RETURN(part.mesh.faces.corners, (TakeThrees<Triangle, uint32_t>(&file, set + ".faces")));
  TESSERA_ASSIGN_OR_RETURN(part.mesh.faces.labels, file.Take<int32_t>(set + ".labels"));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<double> tile, file.Take<double>(set + ".tile", 8));
  part.error_m = tile[0];
  part.samples_error_m = tile[1];
  part.box = {Eigen::Vector3d(tile[2], tile[3], tile[4]), Eigen::Vector3d(tile[5], tile[6], tile[7])};
  TESSERA_ASSIGN_OR_RETURN(const auto samples, (TakeThrees<Eigen::Vector3d, double>(&file, set + ".samples")));
  TESSERA_ASSIGN_OR_RETURN(const auto sample_faces, file.Take<uint32_t>(set + ".sample_faces"));
  const size_t count = vertices.positions.size();
  const auto fits = [&](size_t size) { return size == 0 || size == count; };
  if (vertices.normals.size() != count || !fits(vertices.confidence.size()) || !fits(vertices.displacement_m.size()) ||
      !fits(vertices.colors.size()) || vertices.shared.size() != count ||
      part.mesh.faces.labels.size() != part.mesh.faces.size() || sample_faces.size() != samples.size()) {
    return absl::DataLossError(path + ": found arrays of different sizes, expected one value per vertex or face");
  }
  for (const Triangle& face : part.mesh.faces.corners) {
    if (std::max({face[0], face[1], face[2]}) >= count) {
      return absl::DataLossError(absl::StrCat(path, ": expected vertex indices below ", count));
    }
  }
  for (size_t i = 0; i < samples.size(); ++i) {
    if (sample_faces[i] >= part.mesh.faces.size()) {
      return absl::DataLossError(absl::StrCat(path, ": expected faces of samples below ", part.mesh.faces.size()));
    }
    part.samples.push_back({samples[i], sample_faces[i]});
  }
  return part;
}

Status WriteTiles3dBorder(const std::string& path, const Tiles3dMesh& mesh) {
  const std::vector<Eigen::Vector3d>& positions = mesh.vertices.positions;
  std::vector<Eigen::Vector3d> ends;
  for (const auto& [a, b] : Tiles3dSharedEdges(mesh.vertices, mesh.faces)) {
    ends.insert(ends.end(), {positions[a], positions[b]});
  }
  ArrayFile file;
  file.arrays["ends"] = FlatTiles3d<double>(ends);
  return WriteArrayFile(path, file);
}

StatusOr<std::vector<Tiles3dEdge>> ReadTiles3dBorder(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(ArrayFile file, ReadArrayFile(path));
  TESSERA_ASSIGN_OR_RETURN(const auto ends, (TakeThrees<Eigen::Vector3d, double>(&file, "ends")));
  if (ends.size() % 2 != 0) return absl::DataLossError(path + ": ends: expected pairs of positions");
  std::vector<Tiles3dEdge> edges;
  for (size_t i = 0; i < ends.size(); i += 2) edges.push_back({ends[i], ends[i + 1]});
  return edges;
}

Tiles3dMesh MergeTiles3d(const std::vector<Tiles3dMesh>& meshes, std::vector<uint32_t>* source) {
  Tiles3dVertices all;
  Tiles3dFaces faces;
  uint32_t first_face = 0;
  PositionIndex positions;
  std::vector<uint32_t> vertex_of_position, welded;  // welded: per vertex, the one that takes its place
  for (const Tiles3dMesh& mesh : meshes) {
    const auto offset = static_cast<uint32_t>(all.positions.size());
    const std::vector<uint8_t> border = Tiles3dBorder(mesh.faces, mesh.vertices.positions.size());
    for (uint32_t v = 0; v < border.size(); ++v) {
      welded.push_back(offset + v);
      if (!border[v] && !mesh.vertices.shared[v]) continue;
      const uint32_t number = positions.NumberOf(mesh.vertices.positions[v]);
      if (number == vertex_of_position.size()) vertex_of_position.push_back(offset + v);
      welded.back() = vertex_of_position[number];
    }
    AppendTiles3d(mesh.vertices.positions, &all.positions);
    AppendTiles3d(mesh.vertices.normals, &all.normals);
    AppendTiles3d(mesh.vertices.confidence, &all.confidence);
    AppendTiles3d(mesh.vertices.displacement_m, &all.displacement_m);
    AppendTiles3d(mesh.vertices.colors, &all.colors);
    AppendTiles3d(mesh.vertices.shared, &all.shared);
    for (size_t f = 0; f < mesh.faces.size(); ++f) {
      Triangle face = mesh.faces.corners[f];
      for (uint32_t& v : face) v = welded[offset + v];
      const bool has_area = face[0] != face[1] && face[1] != face[2] && face[2] != face[0];
      if (has_area) {
        faces.Add(face, mesh.faces.labels[f]);
        source->push_back(first_face + static_cast<uint32_t>(f));
      }
    }
    first_face += static_cast<uint32_t>(mesh.faces.size());
  }
  // What only some of the meshes have is not known.
  const size_t count = all.positions.size();
  if (all.confidence.size() != count) all.confidence.clear();
  if (all.displacement_m.size() != count) all.displacement_m.clear();
  if (all.colors.size() != count) all.colors.clear();
  return CompactTiles3d(all, faces);
}

}  // namespace tessera
