#include "common/meshio/gltf.h"

#include <Eigen/LU>
#include <array>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/geometry/position_index.h"
#include "common/meshio/gltf_document.h"
#include "common/meshio/text_words.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

constexpr int64_t kMaxGltfFileBytes = std::numeric_limits<uint32_t>::max();  // the limit of GLB
// Nodes may place a mesh any number of times. This bounds the vertices and corners that come out of a file.
constexpr int64_t kPlacedElements = 1 << 24, kPlacedElementsPerByte = 64;
constexpr int64_t kTriangles = 4, kStrip = 5, kFan = 6;
constexpr uint32_t kUnread = std::numeric_limits<uint32_t>::max();

class GltfReader {
 public:
  GltfReader(GltfDocument& document, int64_t size_bytes, const std::string& name, const MeshReadOptions& options,
             MeshSink& sink)
      : document_(document),
        name_(name),
        options_(options),
        sink_(sink),
        max_elements_(kPlacedElements + kPlacedElementsPerByte * size_bytes) {
    if (options.materials == nullptr) attribute_ = options.label_property.value_or("");
  }

  Status Read() {
    MeshLayout layout;
    layout.label_property = options_.materials != nullptr ? "material" : attribute_;
    if (!layout.label_property.empty()) layout.labels = MeshLabels::kOfFaces;
    TESSERA_RETURN_IF_ERROR(sink_.Begin(layout));
    TESSERA_RETURN_IF_ERROR(ReadNodes());
    if (!attribute_.empty() && labelled_primitives_ == 0) {
      return Error("meshes", absl::StrCat("no vertex attribute ", Quoted(attribute_)),
                   "the name of an attribute with a class index per vertex, such as _FEATURE_ID_0");
    }
    WarnOf(left_out_primitives_, "primitives of points or lines left out");
    WarnOf(instancing_nodes_, "nodes with EXT_mesh_gpu_instancing: their mesh is read once, where the node is");
    WarnOf(deformed_, "nodes with a skin or morph targets: read without deformation");
    WarnOf(degenerate_faces_, "faces with two corners at one position left out");
    WarnOf(mixed_faces_, "faces have vertices of different labels and take the label of most of them");
    return absl::OkStatus();
  }

 private:
  // Where the vertices of a primitive are placed.
  struct Placed {
    GltfValues positions;
    Eigen::Matrix4d file_from_node;
    int64_t accessor = -1, node = -1;
    std::vector<uint32_t> numbers;  // in the sink, by vertex; kUnread
  };

  Status ReadNodes() {
    struct Pending {
      int64_t node;
      Eigen::Matrix4d file_from_parent;
    };
    std::vector<Pending> pending;
    TESSERA_ASSIGN_OR_RETURN(const std::vector<int64_t> roots, document_.RootNodes());
    for (auto root = roots.rbegin(); root != roots.rend(); ++root) {
      pending.push_back({*root, Eigen::Matrix4d::Identity()});
    }
    std::vector<bool> visited(static_cast<size_t>(document_.NodeCount()));
    while (!pending.empty()) {
      const auto [index, file_from_parent] = pending.back();
      pending.pop_back();
      TESSERA_ASSIGN_OR_RETURN(const GltfNode node, document_.Node(index, "nodes"));
      if (visited[static_cast<size_t>(index)]) {
        return Error(absl::StrCat("nodes[", index, "]"), "a node with several parents", "a tree of nodes");
      }
      visited[static_cast<size_t>(index)] = true;
      const Eigen::Matrix4d file_from_node = file_from_parent * node.parent_from_node;
      if (!file_from_node.allFinite() || file_from_node.row(3) != Eigen::RowVector4d(0, 0, 0, 1)) {
        return Error(absl::StrCat("nodes[", index, "].matrix"), "no affine transform", "a last row of 0, 0, 0, 1");
      }
      for (auto child = node.children.rbegin(); child != node.children.rend(); ++child) {
        pending.push_back({*child, file_from_node});
      }
      if (node.mesh >= 0) TESSERA_RETURN_IF_ERROR(ReadMeshOf(node, index, file_from_node));
    }
    return absl::OkStatus();
  }

  Status ReadMeshOf(const GltfNode& node, int64_t index, const Eigen::Matrix4d& file_from_node) {
    TESSERA_ASSIGN_OR_RETURN(const std::vector<GltfPrimitive> primitives,
                             document_.Primitives(node.mesh, attribute_, absl::StrCat("nodes[", index, "].mesh")));
    instancing_nodes_ += node.instances;
    bool is_deformed = node.has_skin;
    for (const GltfPrimitive& primitive : primitives) {
      is_deformed |= primitive.has_morph_targets;
      if (primitive.mode < kTriangles) {
        ++left_out_primitives_;
      } else if (primitive.mode > kFan) {
        return Error(primitive.location + ".mode", absl::StrCat(primitive.mode), "0 to 6");
      } else {
        TESSERA_RETURN_IF_ERROR(ReadPrimitive(primitive, index, file_from_node));
      }
    }
    deformed_ += is_deformed;
    return absl::OkStatus();
  }

  Status ReadPrimitive(const GltfPrimitive& primitive, int64_t node, const Eigen::Matrix4d& file_from_node) {
    if (primitive.positions != placed_.accessor || node != placed_.node) {
      placed_.accessor = primitive.positions;
      placed_.node = node;
      placed_.file_from_node = file_from_node;
      TESSERA_ASSIGN_OR_RETURN(placed_.positions,
                               document_.Values(primitive.positions, "VEC3", primitive.location + ".POSITION"));
      TESSERA_RETURN_IF_ERROR(CountElements(placed_.positions.count, primitive.location));
      placed_.numbers.assign(static_cast<size_t>(placed_.positions.count), kUnread);
    }
    GltfValues indices, labels;
    int64_t corners = placed_.positions.count;
    if (primitive.indices >= 0) {
      const std::string location = primitive.location + ".indices";
      TESSERA_ASSIGN_OR_RETURN(indices, document_.Values(primitive.indices, "SCALAR", location));
      if (indices.component_type % 2 == 0 || indices.component_type > 5125) {
        return Error(location, absl::StrCat("componentType ", indices.component_type), "5121, 5123 or 5125");
      }
      indices.normalized = false;
      corners = indices.count;
    }
    int32_t label = options_.materials != nullptr || !attribute_.empty() ? -1 : 0;
    if (options_.materials != nullptr && primitive.material >= 0) {
      TESSERA_ASSIGN_OR_RETURN(const std::string material,
                               document_.MaterialName(primitive.material, primitive.location + ".material"));
      label = options_.materials->IndexOf(material);
    }
    if (primitive.labels >= 0) {
      const std::string location = absl::StrCat(primitive.location, ".", attribute_);
      TESSERA_ASSIGN_OR_RETURN(labels, document_.Values(primitive.labels, "SCALAR", location));
      labels.normalized = false;
      if (labels.count < placed_.positions.count) {
        return Error(location, absl::StrCat(labels.count, " values"),
                     absl::StrCat("one for each of ", placed_.positions.count, " vertices"));
      }
      ++labelled_primitives_;
    }
    TESSERA_RETURN_IF_ERROR(CountElements(corners, primitive.location));
    const bool is_mirrored = file_from_node.topLeftCorner<3, 3>().determinant() < 0;
    const int64_t step = primitive.mode == kTriangles ? 3 : 1;
    for (int64_t first = 0; first + 2 < corners; first += step) {
      std::array<int64_t, 3> triangle = {first, first + 1, first + 2};
      if (primitive.mode == kFan) triangle[0] = 0;
      if (primitive.mode == kStrip && first % 2 == 1) std::swap(triangle[1], triangle[2]);
      if (is_mirrored) std::swap(triangle[1], triangle[2]);  // glTF: the winding order is reversed
      if (primitive.indices >= 0) {
        for (int64_t& corner : triangle) corner = static_cast<int64_t>(indices.At(corner, 0));
      }
      TESSERA_RETURN_IF_ERROR(AddFace(primitive, triangle, labels, label));
    }
    return absl::OkStatus();
  }

  // `corners`: vertices of the primitive.
  Status AddFace(const GltfPrimitive& primitive, const std::array<int64_t, 3>& corners, const GltfValues& labels,
                 int32_t label) {
    Triangle face;
    for (size_t k = 0; k < 3; ++k) {
      TESSERA_ASSIGN_OR_RETURN(face[k], VertexOf(primitive, corners[k]));
    }
    if (face[0] == face[1] || face[1] == face[2] || face[2] == face[0]) {
      // Strips have such faces on purpose.
      degenerate_faces_ += primitive.mode == kTriangles;
      return absl::OkStatus();
    }
    if (labels.data != nullptr) {
      std::array<int32_t, 3> values{};
      for (size_t k = 0; k < 3; ++k) {
        const double value = labels.At(corners[k], 0);
        if (!(value >= -1 && value <= std::numeric_limits<int32_t>::max() && value == std::floor(value))) {
          return Error(absl::StrCat(primitive.location, ".", attribute_, ": vertex ", corners[k]),
                       absl::StrCat("label ", value), "a class index, or -1 for no label");
        }
        values[k] = static_cast<int32_t>(value);
      }
      label = values[1] == values[2] ? values[1] : values[0];
      mixed_faces_ += values[0] != values[1] || values[1] != values[2];
    }
    sink_.AddFace(face, label);
    return absl::OkStatus();
  }

  // The number of the primitive's vertex in the sink, which gets it if no vertex was there before.
  StatusOr<uint32_t> VertexOf(const GltfPrimitive& primitive, int64_t vertex) {
    if (vertex >= placed_.positions.count) {
      return Error(primitive.location + ".indices", absl::StrCat("vertex ", vertex),
                   absl::StrCat("0 to ", placed_.positions.count - 1));
    }
    uint32_t& number = placed_.numbers[static_cast<size_t>(vertex)];
    if (number != kUnread) return number;
    Eigen::Vector3d position;
    for (int k = 0; k < 3; ++k) position[k] = placed_.positions.At(vertex, k);
    position = placed_.file_from_node.topLeftCorner<3, 3>() * position + placed_.file_from_node.topRightCorner<3, 1>();
    if (!position.allFinite()) {
      return Error(absl::StrCat(primitive.location, ".POSITION: vertex ", vertex), "coordinates that are not finite",
                   "finite coordinates");
    }
    const size_t before = vertices_.positions().size();
    if (before == kUnread) return Error(primitive.location, "one vertex more", absl::StrCat("at most ", kUnread));
    number = vertices_.NumberOf({position.x(), -position.z(), position.y()});
    if (number == before) sink_.AddVertex(vertices_.positions().back(), 0);
    return number;
  }

  Status CountElements(int64_t count, const std::string& location) {
    elements_ += count;
    if (elements_ <= max_elements_) return absl::OkStatus();
    return Error(location, absl::StrCat("more than ", max_elements_, " vertices and corners in all nodes"),
                 "fewer nodes with the same mesh");
  }

  void WarnOf(int64_t count, const char* what) const {
    if (count > 0) options_.Warn(absl::StrCat(count, " ", what));
  }

  Status Error(const std::string& location, const std::string& found, const std::string& expected) const {
    return InputError(name_, location, found, expected);
  }

  GltfDocument& document_;
  const std::string& name_;
  const MeshReadOptions& options_;
  MeshSink& sink_;
  std::string attribute_;  // with the labels; empty: none
  const int64_t max_elements_;
  PositionIndex vertices_;
  Placed placed_;
  int64_t elements_ = 0, labelled_primitives_ = 0;
  int64_t left_out_primitives_ = 0, instancing_nodes_ = 0, deformed_ = 0, degenerate_faces_ = 0, mixed_faces_ = 0;
};

Status StreamGltfBytes(const std::string& bytes, const std::string& name, const std::string& folder,
                       const MeshReadOptions& options, MeshSink& sink) {
  TESSERA_ASSIGN_OR_RETURN(const std::unique_ptr<GltfDocument> document, GltfDocument::Parse(bytes, name, folder));
  return GltfReader(*document, document->size_bytes(), name, options, sink).Read();
}

}  // namespace

bool IsGltf(std::string_view head) {
  if (head.starts_with("glTF")) return true;
  const size_t begin = head.find_first_not_of(" \t\r\n");
  if (begin == std::string_view::npos || head[begin] != '{') return false;
  for (const std::string_view key : {"\"asset\"", "\"accessors\"", "\"bufferViews\"", "\"meshes\"", "\"scenes\""}) {
    if (head.find(key) != std::string_view::npos) return true;
  }
  return false;
}

bool GltfHasLabels(std::string_view, const std::optional<std::string>&) { return false; }

StatusOr<MeshContent> ReadGltf(const std::string& path, const MeshReadOptions& options) {
  return CollectMesh(path, options, [&](MeshSink& sink) { return StreamGltf(path, options, &sink); });
}

Status StreamGltf(const std::string& path, const MeshReadOptions& options, MeshSink* sink) {
  TESSERA_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path, kMaxGltfFileBytes));
  const std::string folder = std::filesystem::path(AbsolutePath(path)).parent_path().string();
  return StreamGltfBytes(bytes, path, folder, options, *sink);
}

StatusOr<bool> GltfHasMoreFaces(const std::string& path, int64_t max_faces) {
  TESSERA_ASSIGN_OR_RETURN(const int64_t faces,
                           CountTriangles([&](MeshSink& sink) { return StreamGltf(path, MeshReadOptions(), &sink); }));
  return faces > max_faces;
}

StatusOr<MeshContent> ParseGltf(const std::string& bytes, const std::string& name, const MeshReadOptions& options) {
  return CollectMesh(name, options, [&](MeshSink& sink) { return StreamGltfBytes(bytes, name, "", options, sink); });
}

}  // namespace tessera
