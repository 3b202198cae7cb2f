// Reads tile sets with their GLB files, by the specifications alone; makes terrain in sheets.
#pragma once

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <cstring>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "common/base/random.h"
#include "common/exporting/tiles3d/tiles3d.h"
#include "common/storage/files.h"

namespace tessera {

// All vertices and triangles of a GLB file in east-north-up coordinates.
struct ReadTileGlb {
  nlohmann::json json;
  std::string buffer;
  TriangleMesh mesh;  // labels: feature ids
  std::vector<std::array<uint16_t, 4>> colors;
  std::vector<Eigen::Vector3f> normals;
  std::vector<float> confidence, displacement;

  // Value `index` of an accessor's component.
  template <class T>
  T Value(int accessor, size_t index, size_t component) const {
    const auto& a = json["accessors"][accessor];
    const auto& view = json["bufferViews"][a["bufferView"].get<int>()];
    const size_t width = a["type"] == "SCALAR" ? 1 : a["type"] == "VEC3" ? 3 : 4;
    const size_t stride = view.value("byteStride", width * sizeof(T));
    const size_t at = index * stride + component * sizeof(T);
    EXPECT_LE(at + sizeof(T), view["byteLength"].get<size_t>());
    T value;
    std::memcpy(&value, buffer.data() + view["byteOffset"].get<size_t>() + at, sizeof(T));
    return value;
  }

  // The bytes of a view.
  std::string View(int view) const {
    const auto& v = json["bufferViews"][view];
    return buffer.substr(v["byteOffset"].get<size_t>(), v["byteLength"].get<size_t>());
  }
};

inline ReadTileGlb ParseTiles3dGlb(const std::string& bytes) {
  ReadTileGlb glb;
  const auto number = [&](size_t at) {
    uint32_t value = 0;
    if (at + 4 <= bytes.size()) std::memcpy(&value, bytes.data() + at, 4);
    return value;
  };
  EXPECT_EQ(bytes.substr(0, 4), "glTF");
  EXPECT_EQ(number(4), 2u);
  EXPECT_EQ(number(8), bytes.size());
  const size_t json_bytes = number(12);
  EXPECT_EQ(bytes.substr(16, 4), "JSON");
  EXPECT_EQ(json_bytes % 4, 0u);
  glb.json = nlohmann::json::parse(bytes.substr(20, json_bytes));
  EXPECT_EQ(bytes.substr(24 + json_bytes, 4), std::string("BIN\0", 4));
  glb.buffer = bytes.substr(28 + json_bytes, number(20 + json_bytes));
  EXPECT_EQ(28 + json_bytes + glb.buffer.size(), bytes.size());
  for (const int n : glb.json["scenes"][0]["nodes"]) {
    const auto& node = glb.json["nodes"][n];
    const auto& primitive = glb.json["meshes"][node["mesh"].get<int>()]["primitives"][0];
    const auto& attributes = primitive["attributes"];
    const auto first = static_cast<uint32_t>(glb.mesh.vertices.size());
    const int position = attributes["POSITION"];
    const size_t count = glb.json["accessors"][position]["count"];
    std::vector<int32_t> features;
    for (size_t v = 0; v < count; ++v) {
      std::array<double, 3> p;
      for (int k = 0; k < 3; ++k) {
        p[k] = static_cast<double>(glb.Value<float>(position, v, k)) + node["translation"][k].get<double>();
      }
      glb.mesh.vertices.push_back({p[0], -p[2], p[1]});
      features.push_back(glb.Value<uint16_t>(attributes["_FEATURE_ID_0"], v, 0));
      auto& color = glb.colors.emplace_back();
      for (int k = 0; k < 4; ++k) color[k] = glb.Value<uint16_t>(attributes["COLOR_0"], v, k);
      if (attributes.contains("NORMAL")) {
        auto& normal = glb.normals.emplace_back();
        for (int k = 0; k < 3; ++k) normal[k] = glb.Value<float>(attributes["NORMAL"], v, k);
      }
      if (attributes.contains("_CONFIDENCE")) {
        glb.confidence.push_back(glb.Value<float>(attributes["_CONFIDENCE"], v, 0));
      }
      if (attributes.contains("_DISPLACEMENT")) {
        glb.displacement.push_back(glb.Value<float>(attributes["_DISPLACEMENT"], v, 0));
      }
    }
    const auto& indices = glb.json["accessors"][primitive["indices"].get<int>()];
    for (size_t f = 0; f < indices["count"].get<size_t>() / 3; ++f) {
      Triangle face;
      for (int k = 0; k < 3; ++k) {
        face[k] = indices["componentType"] == 5123 ? glb.Value<uint16_t>(primitive["indices"], 3 * f + k, 0)
                                                   : glb.Value<uint32_t>(primitive["indices"], 3 * f + k, 0);
        EXPECT_LT(face[k], count);
        EXPECT_EQ(features[face[k]], features[face[0]]);  // a vertex belongs to one class
      }
      glb.mesh.labels.push_back(features[face[0]]);
      for (uint32_t& v : face) v += first;
      glb.mesh.faces.push_back(face);
    }
  }
  return glb;
}

struct ReadTile {
  Eigen::AlignedBox3d box;
  double error_m = 0;
  std::string path;  // of the GLB file
  bool is_leaf = false;
  std::vector<ReadTile> children;
};

inline nlohmann::json ReadTileJson(const std::string& path) { return nlohmann::json::parse(*ReadFile(path)); }

// `json`: a tile; `folder`: that its uri is relative to. The tile of another tile set is that tile set's root.
inline ReadTile ReadTiles3dTile(const nlohmann::json& json, const std::string& folder) {
  const std::string path = folder + "/" + json["content"]["uri"].get<std::string>();
  if (path.ends_with("/tileset.json")) {
    const nlohmann::json root = ReadTileJson(path)["root"];
    EXPECT_EQ(root["geometricError"], json["geometricError"]);
    EXPECT_FALSE(root.contains("transform"));
    return ReadTiles3dTile(root, path.substr(0, path.rfind('/')));
  }
  ReadTile tile;
  tile.path = path;
  tile.error_m = json["geometricError"];
  const auto& box = json["boundingVolume"]["box"];
  const Eigen::Vector3d centre(box[0], box[1], box[2]), half(box[3], box[7], box[11]);
  tile.box = {centre - half, centre + half};
  tile.is_leaf = !json.contains("children");
  if (!tile.is_leaf) {
    for (const auto& child : json["children"]) tile.children.push_back(ReadTiles3dTile(child, folder));
  }
  return tile;
}

inline ReadTile ReadTiles3d(const std::string& folder) {
  return ReadTiles3dTile(ReadTileJson(folder + "/tileset.json")["root"], folder);
}

// Rough ground with steps, holes and four classes, divided into sheets of 16 x 16 cells of 1 m, and exported.
struct ExportedTerrain {
  TempFolder folder = *TempFolder::Create(testing::TempDir());
  ExportScene scene;
  ExportOptions options;
  std::map<SheetId, Sheet> sheets;
  Tiles3dSizes sizes = {.leaf_faces = 500, .error = 1.0 / 20};

  // `side`: squares along a side, of 0.5 m; their middle is at the local origin, where four sheets meet.
  explicit ExportedTerrain(int side, uint64_t seed, const Crs& crs = {}, const Eigen::Vector3d& near = {0, 0, 0}) {
    scene.frame = *Frame::Around(crs, near);
    scene.gsd_m = 0.02;
    scene.ground.cell_m = 1;
    for (const char* name : {"ground", "facade", "<img src=x onerror=alert(1)>", "\xff\x1b[2J\"}"}) {
      SceneClass& c = scene.classes.emplace_back();
      c.name = name;
      c.color_rgb = {static_cast<uint8_t>(60 * scene.classes.size()), 20, 255};
    }
    Random random(seed);
    std::vector<Eigen::Vector3d> vertices;
    for (int y = 0; y <= side; ++y) {
      for (int x = 0; x <= side; ++x) {
        const bool on_house = (x / 9 + y / 7) % 3 == 0;
        const Eigen::Vector2d p = Eigen::Vector2d(x - side / 2, y - side / 2) * 0.5;
        vertices.push_back({p.x() + random.Uniform(-0.1, 0.1), p.y() + random.Uniform(-0.1, 0.1),
                            std::sin(p.x() / 5) + (on_house ? 6 : 0) + random.Uniform(-0.05, 0.05)});
      }
    }
    std::map<SheetId, std::map<uint32_t, uint32_t>> numbers;
    const auto add = [&](const Triangle& face, int32_t label) {
      const Eigen::Vector3d centroid = (vertices[face[0]] + vertices[face[1]] + vertices[face[2]]) / 3;
      const SheetId id = SheetOf(scene.ground.Cell(centroid));
      Sheet& sheet = sheets[id];
      Triangle& out = sheet.faces.emplace_back();
      for (int k = 0; k < 3; ++k) {
        const auto [it, is_new] = numbers[id].try_emplace(face[k], static_cast<uint32_t>(sheet.vertices.size()));
        if (is_new) sheet.vertices.push_back(vertices[face[k]]);
        out[k] = it->second;
      }
      sheet.labels.push_back(label);
      sheet.confidence.push_back(static_cast<float>(random.Uniform()));
    };
    for (int y = 0; y < side; ++y) {
      for (int x = 0; x < side; ++x) {
        if (random.Below(200) == 0) continue;  // a hole
        const auto v = static_cast<uint32_t>(y * (side + 1) + x);
        const uint32_t right = v + 1, up = v + side + 1, both = up + 1;
        const auto label = static_cast<int32_t>(random.Below(50) == 0 ? random.Below(6) - 1 : (x / 9 + y / 7) % 3);
        const bool turned = random.Below(2) == 0;
        add(turned ? Triangle{v, right, both} : Triangle{v, right, up}, label);
        add(turned ? Triangle{v, both, up} : Triangle{right, both, up}, label);
      }
    }
    std::map<uint32_t, int> uses;
    for (const auto& [id, of_sheet] : numbers) {
      for (const auto& [v, number] : of_sheet) ++uses[v];
    }
    for (auto& [id, sheet] : sheets) {
      sheet.displacement_m.assign(sheet.vertices.size(), 0.25f);
      sheet.shared.resize(sheet.vertices.size());
      for (const auto& [v, number] : numbers[id]) sheet.shared[number] = uses[v] > 1 ? 1 : 0;
    }
  }

  // Writes all; the start of each sheet is the sheet moved down, if `with_start`.
  void Write(bool with_start = false, const SheetId& quarantined = {1000, 1000}) {
    JoinInput join{scene, options, {}};
    for (const auto& [id, sheet] : sheets) {
      SheetInput input{scene, options, id, sheet, {}, {}, {}, {}, {}, id == quarantined};
      if (with_start) {
        input.start = sheet;
        for (Eigen::Vector3d& p : input.start->vertices) p.z() -= 1;
      }
      const StatusOr<std::vector<std::string>> written = WriteTiles3dSheet(input, folder.path(), TaskControl(), sizes);
      ASSERT_TRUE(written.ok()) << written.status();
      files.insert(files.end(), written->begin(), written->end());
      const std::string part = folder.path() + "/part" + SheetName(id);
      ASSERT_TRUE(RenameDurably(folder.path() + "/" + kPartFile, part).ok());
      join.sheets.push_back({id, "", part, input.set_aside});
    }
    const StatusOr<std::vector<std::string>> joined = JoinTiles3d(join, folder.path(), TaskControl(), sizes);
    ASSERT_TRUE(joined.ok()) << joined.status();
    files.insert(files.end(), joined->begin(), joined->end());
  }

  std::string path(const std::string& name) const { return folder.path() + "/" + name; }
  std::vector<std::string> files;  // that were written, without parts
};

}  // namespace tessera
