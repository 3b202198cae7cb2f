// tinygltf, which is not ours, reads every GLB file of an export: its meshes, feature ids and tables of classes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tiny_gltf.h>

#include <string_view>

#include "common/exporting/mesh_files/glb_export.h"
#include "tests/unit/common/exporting/tiles3d_reader.h"

namespace tessera {
namespace {

tinygltf::Model TinyModel(const std::string& path) {
  tinygltf::Model model;
  std::string error, warning;
  EXPECT_TRUE(tinygltf::TinyGLTF().LoadBinaryFromFile(&model, &error, &warning, path)) << path << ": " << error;
  EXPECT_EQ(error + warning, "") << path;
  return model;
}

// The values of an accessor with `width` components of type T each.
template <class T>
std::vector<T> TinyValues(const tinygltf::Model& model, int accessor, int width) {
  const tinygltf::Accessor& a = model.accessors.at(accessor);
  const tinygltf::BufferView& view = model.bufferViews.at(a.bufferView);
  EXPECT_EQ(tinygltf::GetComponentSizeInBytes(static_cast<uint32_t>(a.componentType)), static_cast<int>(sizeof(T)));
  EXPECT_EQ(tinygltf::GetNumComponentsInType(static_cast<uint32_t>(a.type)), width);
  const std::vector<unsigned char>& buffer = model.buffers.at(view.buffer).data;
  std::vector<T> values;
  for (size_t i = 0; i < a.count; ++i) {
    for (int k = 0; k < width; ++k) {
      const size_t at = view.byteOffset + a.byteOffset + i * static_cast<size_t>(a.ByteStride(view)) + k * sizeof(T);
      if (at + sizeof(T) > buffer.size()) {
        ADD_FAILURE() << "accessor " << accessor << " ends behind its buffer";
        return values;
      }
      T value;
      std::memcpy(&value, buffer.data() + at, sizeof(T));
      values.push_back(value);
    }
  }
  return values;
}

std::vector<size_t> TinyIndices(const tinygltf::Model& model, int accessor) {
  std::vector<size_t> indices;
  if (model.accessors.at(accessor).componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT) {
    for (const uint16_t i : TinyValues<uint16_t>(model, accessor, 1)) indices.push_back(i);
  } else {
    for (const uint32_t i : TinyValues<uint32_t>(model, accessor, 1)) indices.push_back(i);
  }
  return indices;
}

// The bytes of the buffer view with this number.
std::string_view TinyView(const tinygltf::Model& model, const tinygltf::Value& number) {
  const tinygltf::BufferView& view = model.bufferViews.at(number.GetNumberAsInt());
  const std::vector<unsigned char>& buffer = model.buffers.at(view.buffer).data;
  return std::string_view(reinterpret_cast<const char*>(buffer.data()), buffer.size())
      .substr(view.byteOffset, view.byteLength);
}

struct TinyClass {
  std::string name;
  std::array<uint8_t, 3> color;
  int asprs;
};

// The rows of the property table that the primitive's feature ids refer to.
std::vector<TinyClass> TinyClasses(const tinygltf::Model& model, const tinygltf::Primitive& primitive) {
  const tinygltf::Value& feature = primitive.extensions.at("EXT_mesh_features").Get("featureIds").Get(0);
  EXPECT_EQ(feature.Get("attribute").GetNumberAsInt(), 0);
  const tinygltf::Value& metadata = model.extensions.at("EXT_structural_metadata");
  const tinygltf::Value& table = metadata.Get("propertyTables").Get(feature.Get("propertyTable").GetNumberAsInt());
  const tinygltf::Value& columns = table.Get("properties");
  const std::string_view names = TinyView(model, columns.Get("name").Get("values"));
  const std::string_view offsets = TinyView(model, columns.Get("name").Get("stringOffsets"));
  const std::string_view colors = TinyView(model, columns.Get("color").Get("values"));
  const std::string_view codes = TinyView(model, columns.Get("asprs").Get("values"));
  const size_t count = table.Get("count").GetNumberAsInt();
  EXPECT_EQ(feature.Get("featureCount").GetNumberAsInt(), static_cast<int>(count));
  EXPECT_EQ(offsets.size(), 4 * (count + 1));
  EXPECT_EQ(colors.size(), 3 * count);
  EXPECT_EQ(codes.size(), count);
  std::vector<TinyClass> classes;
  for (size_t i = 0; i < count; ++i) {
    std::array<uint32_t, 2> range;
    std::memcpy(range.data(), offsets.data() + 4 * i, 8);
    TinyClass& row = classes.emplace_back();
    row.name = names.substr(range[0], range[1] - range[0]);
    std::memcpy(row.color.data(), colors.data() + 3 * i, 3);
    row.asprs = static_cast<uint8_t>(codes[i]);
  }
  return classes;
}

TEST(TinygltfTest, ReadsEveryTile) {
  ExportedTerrain terrain(60, 2);
  terrain.Write(true);
  int tiles = 0;
  for (const std::string& file : terrain.files) {
    if (!file.ends_with(".glb")) continue;
    ++tiles;
    const std::string path = terrain.path(file);
    const tinygltf::Model model = TinyModel(path);
    EXPECT_EQ(model.asset.version, "2.0");
    const ReadTileGlb expected = ParseTiles3dGlb(*ReadFile(path));
    size_t vertices = 0, faces = 0;
    for (const tinygltf::Node& node : model.nodes) {
      const tinygltf::Primitive& primitive = model.meshes.at(node.mesh).primitives.at(0);
      const std::vector<TinyClass> classes = TinyClasses(model, primitive);
      ASSERT_EQ(classes.size(), terrain.scene.classes.size() + 1) << file;
      for (size_t c = 0; c < 3; ++c) {
        EXPECT_EQ(classes[c].name, terrain.scene.classes[c].name) << file;
        EXPECT_EQ(classes[c].color, terrain.scene.classes[c].color_rgb) << file;
      }
      EXPECT_EQ(classes[0].asprs, 2);
      EXPECT_EQ(classes.back().name, "unlabelled");
      const auto positions = TinyValues<float>(model, primitive.attributes.at("POSITION"), 3);
      const auto features = TinyValues<uint16_t>(model, primitive.attributes.at("_FEATURE_ID_0"), 1);
      const auto confidence = primitive.attributes.contains("_CONFIDENCE")
                                  ? TinyValues<float>(model, primitive.attributes.at("_CONFIDENCE"), 1)
                                  : std::vector<float>();
      const std::vector<size_t> indices = TinyIndices(model, primitive.indices);
      ASSERT_EQ(positions.size(), 3 * features.size()) << file;
      EXPECT_EQ(TinyValues<uint16_t>(model, primitive.attributes.at("COLOR_0"), 4).size(), 4 * features.size());
      EXPECT_EQ(TinyValues<float>(model, primitive.attributes.at("NORMAL"), 3).size(), positions.size());
      for (size_t v = 0; v < features.size(); ++v) {
        EXPECT_LT(features[v], classes.size());
        const Eigen::Vector3d p(positions[3 * v] + node.translation.at(0),
                                positions[3 * v + 1] + node.translation.at(1),
                                positions[3 * v + 2] + node.translation.at(2));
        EXPECT_EQ(Eigen::Vector3d(p.x(), -p.z(), p.y()), expected.mesh.vertices.at(vertices + v)) << file;
        if (!confidence.empty()) {
          EXPECT_EQ(confidence[v], expected.confidence.at(vertices + v)) << file;
        }
      }
      for (size_t i = 0; i < indices.size(); ++i) {
        ASSERT_LT(indices[i], features.size());
        EXPECT_EQ(vertices + indices[i], expected.mesh.faces.at(faces + i / 3)[i % 3]);
        EXPECT_EQ(features[indices[i]], expected.mesh.labels.at(faces + i / 3));
      }
      vertices += features.size();
      faces += indices.size() / 3;
    }
    EXPECT_EQ(vertices, expected.mesh.vertices.size());
    EXPECT_EQ(faces, expected.mesh.faces.size());
  }
  EXPECT_GT(tiles, 30);
}

TEST(TinygltfTest, ReadsTheWholeMesh) {
  ExportedTerrain terrain(60, 3);
  JoinInput join{terrain.scene, terrain.options, {}};
  size_t faces = 0;
  for (const auto& [id, sheet] : terrain.sheets) {
    const SheetInput input{terrain.scene, terrain.options, id, sheet, {}, {}, {}, {}, {}, false};
    ASSERT_TRUE(WriteGlbPart(input, terrain.folder.path(), TaskControl()).ok());
    const std::string part = terrain.path("part" + SheetName(id));
    ASSERT_TRUE(RenameDurably(terrain.path(kPartFile), part).ok());
    join.sheets.push_back({id, "", part, false});
    faces += sheet.faces.size();
  }
  ASSERT_TRUE(JoinGlb(join, terrain.folder.path(), TaskControl()).ok());
  const tinygltf::Model model = TinyModel(terrain.path("mesh.glb"));
  std::vector<std::string> names;
  size_t found = 0;
  for (const tinygltf::Primitive& primitive : model.meshes.at(0).primitives) {
    const size_t count = TinyValues<float>(model, primitive.attributes.at("POSITION"), 3).size() / 3;
    const std::vector<size_t> indices = TinyIndices(model, primitive.indices);
    EXPECT_LT(*std::max_element(indices.begin(), indices.end()), count);
    found += indices.size() / 3;
    names.push_back(model.materials.at(primitive.material).name);
  }
  EXPECT_EQ(found, faces);
  EXPECT_THAT(names, testing::IsSupersetOf({"ground", "facade", "<img src=x onerror=alert(1)>"}));
}

}  // namespace
}  // namespace tessera
