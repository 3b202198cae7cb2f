#include "common/exporting/tiles3d/tiles3d_glb.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "common/base/printable.h"
#include "common/exporting/color/vertex_colors.h"
#include "common/exporting/gltf_conventions.h"

namespace tessera {
namespace {

using TileObject = nlohmann::json;

static_assert(std::endian::native == std::endian::little);  // as GLB

// Floats are exact so far from the translation; wider meshes are divided into squares.
constexpr double kTileExactRange_m = 4096;

struct TileNameClass {
  std::string_view part;
  uint8_t asprs;
};
// The first whose `part` is in the name; ASPRS LAS 1.4 R15, table 17.
constexpr std::array<TileNameClass, 12> kTileAsprsClasses = {{{"ground", 2},
                                                              {"terrain", 2},
                                                              {"vegetation", 5},
                                                              {"tree", 5},
                                                              {"roof", 6},
                                                              {"facade", 6},
                                                              {"wall", 6},
                                                              {"building", 6},
                                                              {"water", 9},
                                                              {"rail", 10},
                                                              {"road", 11},
                                                              {"bridge", 17}}};

// LinearLight16 of each value.
std::array<uint16_t, 256> TileLinearTable() {
  std::array<uint16_t, 256> table;
  for (int c = 0; c < 256; ++c) table[c] = LinearLight16(static_cast<uint8_t>(c));
  return table;
}

// The file while it grows: its JSON and its buffer.
class TileGlbBuilder {
 public:
  // Appends values as a buffer view that begins at a multiple of 8; returns its index. `stride`, `target`: 0: none.
  template <class T>
  int AddView(const std::vector<T>& values, int stride, int target) {
    buffer_.resize((buffer_.size() + 7) / 8 * 8, '\0');
    const size_t bytes = values.size() * sizeof(T);
    TileObject view = {{"buffer", 0}, {"byteOffset", buffer_.size()}, {"byteLength", bytes}};
    if (stride > 0) view["byteStride"] = stride;
    if (target > 0) view["target"] = target;
    buffer_.append(reinterpret_cast<const char*>(values.data()), bytes);
    return Append("bufferViews", std::move(view));
  }

  template <class T>
  int AddAccessor(const std::vector<T>& values, int stride, int target, int component, const char* type, size_t count) {
    return Append("accessors", {{"bufferView", AddView(values, stride, target)},
                                {"componentType", component},
                                {"type", type},
                                {"count", count}});
  }

  int Append(const char* list, TileObject item) {
    json[list].push_back(std::move(item));
    return static_cast<int>(json[list].size()) - 1;
  }

  std::string Finish() {
    json["buffers"] = {{{"byteLength", buffer_.size()}}};
    std::string text = json.dump(-1, ' ', false, TileObject::error_handler_t::replace);
    text.resize((text.size() + 3) / 4 * 4, ' ');
    buffer_.resize((buffer_.size() + 3) / 4 * 4, '\0');
    std::string file;
    const auto add = [&](size_t value) {
      const auto number = static_cast<uint32_t>(value);
      file.append(reinterpret_cast<const char*>(&number), sizeof(number));
    };
    for (const size_t value : {size_t{kGlbMagic}, size_t{2}, 28 + text.size() + buffer_.size()}) add(value);
    add(text.size());
    add(kGlbJsonChunk);
    file += text;
    add(buffer_.size());
    add(kGlbBinaryChunk);
    file += buffer_;
    return file;
  }

  TileObject json;

 private:
  std::string buffer_;
};

// The table of classes, and the schema of its columns.
void AddTileClassTable(const std::vector<SceneClass>& classes, TileGlbBuilder* glb) {
  std::vector<char> names;
  std::vector<uint32_t> name_ends = {0};
  std::vector<uint8_t> colors, asprs;
  const auto add = [&](const std::string& name, const std::array<uint8_t, 3>& rgb, uint8_t code) {
    const std::string text = AsUtf8(name);
    names.insert(names.end(), text.begin(), text.end());
    name_ends.push_back(static_cast<uint32_t>(names.size()));
    colors.insert(colors.end(), rgb.begin(), rgb.end());
    asprs.push_back(code);
  };
  for (const SceneClass& c : classes) add(c.name, c.color_rgb, AsprsClassOf(c.name));
  add("unlabelled", kUnknownColor, 0);
  const TileObject properties = {
      {"name", {{"type", "STRING"}, {"required", true}}},
      {"color", {{"type", "VEC3"}, {"componentType", "UINT8"}, {"description", "sRGB"}, {"required", true}}},
      {"asprs",
       {{"type", "SCALAR"},
        {"componentType", "UINT8"},
        {"description", "class of ASPRS LAS 1.4"},
        {"required", true}}}};
  const TileObject table = {
      {"class", "surface"},
      {"name", "classes"},
      {"count", asprs.size()},
      {"properties",
       {{"name", {{"values", glb->AddView(names, 0, 0)}, {"stringOffsets", glb->AddView(name_ends, 0, 0)}}},
        {"color", {{"values", glb->AddView(colors, 0, 0)}}},
        {"asprs", {{"values", glb->AddView(asprs, 0, 0)}}}}}};
  glb->json["extensions"]["EXT_structural_metadata"] = {
      {"schema", {{"id", "tessera"}, {"classes", {{"surface", {{"properties", properties}}}}}}},
      {"propertyTables", TileObject::array({table})}};
}

// Per vertex: the mean of the faces around it, by area; on the border the finest mesh's, so that neighbours agree.
std::vector<Eigen::Vector3f> TileSmoothNormals(const Tiles3dVertices& vertices, const Tiles3dFaces& faces) {
  std::vector<Eigen::Vector3f> normals(vertices.positions.size(), Eigen::Vector3f::Zero());
  for (const Triangle& face : faces.corners) {
    const Eigen::Vector3d& a = vertices.positions[face[0]];
    const Eigen::Vector3f cross =
        (vertices.positions[face[1]] - a).cross(vertices.positions[face[2]] - a).cast<float>();
    for (const uint32_t v : face) normals[v] += cross;
  }
  const std::vector<uint8_t> border = Tiles3dBorder(faces, vertices.positions.size());
  for (size_t v = 0; v < normals.size(); ++v) {
    normals[v] = border[v] ? vertices.normals[v] : normals[v].stableNormalized();
    if (!(normals[v].squaredNorm() > 0.5f)) normals[v] = Eigen::Vector3f::UnitZ();
  }
  return normals;
}

// Faces of a part that floats can represent.
using TileParts = std::map<std::array<int, 2>, Tiles3dFaces>;

TileParts DivideWideTile(const Tiles3dVertices& vertices, const Tiles3dFaces& faces) {
  Eigen::AlignedBox3d box;
  for (const Triangle& face : faces.corners) {
    for (const uint32_t v : face) box.extend(vertices.positions[v]);
  }
  TileParts parts;
  if (box.sizes().maxCoeff() < 2 * kTileExactRange_m - 2) {
    parts[{0, 0}] = faces;
    return parts;
  }
  for (size_t f = 0; f < faces.size(); ++f) {
    const Eigen::Vector3d& p = vertices.positions[faces.corners[f][0]];
    parts[{static_cast<int>(std::floor(p.x() / kTileExactRange_m)),
           static_cast<int>(std::floor(p.y() / kTileExactRange_m))}]
        .Add(faces.corners[f], faces.labels[f]);
  }
  return parts;
}

struct TilePartLook {
  const std::vector<SceneClass>& classes;
  const std::vector<Eigen::Vector3f>& normals;  // empty: none
};

// Adds the part as a mesh of one primitive and a node.
void AddTilePart(const Tiles3dVertices& vertices, const Tiles3dFaces& faces, const TilePartLook& look,
                 TileGlbBuilder* glb) {
  static const std::array<uint16_t, 256> kLinear = TileLinearTable();
  const Tiles3dWedges wedges = MakeTiles3dWedges(faces, vertices.positions.size());
  const size_t count = wedges.vertices.size();
  Eigen::AlignedBox3d box;
  for (const uint32_t v : wedges.vertices) box.extend(vertices.positions[v]);
  const Eigen::Vector3d translation = box.center().array().round();

  std::vector<Eigen::Vector3f> positions(count), normals;
  std::vector<uint16_t> colors(4 * count), features(2 * count, 0);  // features: padded to 4 bytes
  std::vector<float> confidence, displacement;
  Eigen::AlignedBox3f bounds;
  for (size_t w = 0; w < count; ++w) {
    const uint32_t v = wedges.vertices[w];
    const int32_t label = wedges.labels[w];
    const bool is_class = label >= 0 && static_cast<size_t>(label) < look.classes.size();
    const Eigen::Vector3f about = (vertices.positions[v] - translation).cast<float>();
    positions[w] = GltfFromEnu(about);
    bounds.extend(positions[w]);
    if (!look.normals.empty()) normals.push_back(GltfFromEnu(look.normals[v]));
    const Rgb rgb = !vertices.colors.empty() ? vertices.colors[v]
                    : is_class               ? look.classes[label].color_rgb
                                             : kUnknownColor;
    for (int k = 0; k < 3; ++k) colors[4 * w + k] = kLinear[rgb[k]];
    colors[4 * w + 3] = std::numeric_limits<uint16_t>::max();
    features[2 * w] = static_cast<uint16_t>(is_class ? label : look.classes.size());
    if (!vertices.confidence.empty()) confidence.push_back(vertices.confidence[v]);
    if (!vertices.displacement_m.empty()) displacement.push_back(vertices.displacement_m[v]);
  }

  TileObject attributes;
  const auto add = [&](const char* name, const auto& values, int component, const char* type) {
    const int stride = static_cast<int>(values.size() * sizeof(values[0]) / count);
    const int accessor = glb->AddAccessor(values, stride, kGltfArrayBuffer, component, type, count);
    attributes[name] = accessor;
    return accessor;
  };
  TileObject& position = glb->json["accessors"][add("POSITION", positions, kGltfFloat, "VEC3")];
  position["min"] = {bounds.min().x(), bounds.min().y(), bounds.min().z()};
  position["max"] = {bounds.max().x(), bounds.max().y(), bounds.max().z()};
  if (!normals.empty()) add("NORMAL", normals, kGltfFloat, "VEC3");
  glb->json["accessors"][add("COLOR_0", colors, kGltfUint16, "VEC4")]["normalized"] = true;
  add("_FEATURE_ID_0", features, kGltfUint16, "SCALAR");
  if (!confidence.empty()) add("_CONFIDENCE", confidence, kGltfFloat, "SCALAR");
  if (!displacement.empty()) add("_DISPLACEMENT", displacement, kGltfFloat, "SCALAR");

  std::vector<uint32_t> indices(3 * wedges.faces.size());
  std::memcpy(indices.data(), wedges.faces.data(), indices.size() * sizeof(uint32_t));
  const bool narrow = count <= std::numeric_limits<uint16_t>::max();  // the largest index is reserved
  const int index = narrow ? glb->AddAccessor(std::vector<uint16_t>(indices.begin(), indices.end()), 0,
                                              kGltfIndexBuffer, kGltfUint16, "SCALAR", indices.size())
                           : glb->AddAccessor(indices, 0, kGltfIndexBuffer, kGltfUint32, "SCALAR", indices.size());
  const TileObject feature = {{"featureCount", look.classes.size() + 1}, {"attribute", 0}, {"propertyTable", 0}};
  const TileObject primitive = {
      {"attributes", attributes},
      {"indices", index},
      {"material", 0},
      {"extensions", {{"EXT_mesh_features", {{"featureIds", TileObject::array({feature})}}}}}};
  const int mesh = glb->Append("meshes", {{"primitives", TileObject::array({primitive})}});
  // + 0.0: no -0 in the text.
  const int node = glb->Append(
      "nodes",
      {{"mesh", mesh}, {"translation", {translation.x() + 0.0, translation.z() + 0.0, 0.0 - translation.y()}}});
  glb->json["scenes"][0]["nodes"].push_back(node);
}

}  // namespace

uint8_t AsprsClassOf(const std::string& class_name) {
  std::string lower = class_name;
  for (char& c : lower) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  for (const TileNameClass& c : kTileAsprsClasses) {
    if (lower.find(c.part) != std::string::npos) return c.asprs;
  }
  return 1;
}

std::string MakeTiles3dGlb(const Tiles3dVertices& vertices, const Tiles3dFaces& faces,
                           const std::vector<SceneClass>& classes, bool photographic) {
  TileGlbBuilder glb;
  glb.json["asset"] = {{"version", "2.0"}, {"generator", "Tessera"}};
  glb.json["extensionsUsed"] = {"EXT_mesh_features", "EXT_structural_metadata"};
  glb.json["scene"] = 0;
  TileObject material = {{"pbrMetallicRoughness", {{"metallicFactor", 0}, {"roughnessFactor", 1}}},
                         {"doubleSided", true}};
  if (photographic) {
    material["extensions"]["KHR_materials_unlit"] = TileObject::object();
    glb.json["extensionsUsed"].push_back("KHR_materials_unlit");
  }
  glb.Append("materials", std::move(material));
  std::vector<Eigen::Vector3f> normals;
  if (!photographic) normals = TileSmoothNormals(vertices, faces);
  for (const auto& [square, part] : DivideWideTile(vertices, faces)) {
    AddTilePart(vertices, part, {classes, normals}, &glb);
  }
  AddTileClassTable(classes, &glb);
  return glb.Finish();
}

}  // namespace tessera
