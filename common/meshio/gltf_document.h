// The description in a glTF 2.0 file: nodes, primitives and the values of accessors, each checked when it is read.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"

namespace tessera {

struct GltfNode {
  Eigen::Matrix4d parent_from_node = Eigen::Matrix4d::Identity();
  std::vector<int64_t> children;
  int64_t mesh = -1;       // -1: none
  bool instances = false;  // places its mesh more often by an extension
  bool has_skin = false;
};

// A part of a mesh. Numbers of accessors and materials; -1: none.
struct GltfPrimitive {
  std::string location;
  int64_t mode = 4;  // 4 triangles, 5 strip, 6 fan, 0 to 3 points and lines
  int64_t positions = -1, indices = -1, labels = -1, material = -1;
  bool has_morph_targets = false;
};

// The values of an accessor. They lie in the document.
struct GltfValues {
  const char* data = nullptr;
  int64_t count = 0, stride_bytes = 0;
  int64_t component_type = 0;  // 5120 (int8) to 5126 (float), as in the file
  bool normalized = false;     // integers mean shares of the type's largest value

  double At(int64_t index, int component) const {
    switch (component_type) {
      case 5120:
        return Component<int8_t>(index, component);
      case 5121:
        return Component<uint8_t>(index, component);
      case 5122:
        return Component<int16_t>(index, component);
      case 5123:
        return Component<uint16_t>(index, component);
      case 5125:
        return Component<uint32_t>(index, component);
      default:
        return Component<float>(index, component);
    }
  }

 private:
  template <class T>
  double Component(int64_t index, int component) const {
    T value;
    std::memcpy(&value, data + index * stride_bytes + component * static_cast<int64_t>(sizeof(T)), sizeof(T));
    if (!std::numeric_limits<T>::is_integer || !normalized) return static_cast<double>(value);
    return std::max(static_cast<double>(value) / static_cast<double>(std::numeric_limits<T>::max()), -1.0);
  }
};

// Errors: INVALID_ARGUMENT with the byte or the JSON path, and those of files that are read. `location` in the calls:
// the JSON path that names the object, for errors. Not thread-safe.
class GltfDocument {
 public:
  // `bytes` must outlive the document. `folder`: where files lie that the document names; empty: none are read.
  static StatusOr<std::unique_ptr<GltfDocument>> Parse(const std::string& bytes, const std::string& name,
                                                       const std::string& folder);
  ~GltfDocument();

  // Of the file and of those beside it that it names, as far as it states them.
  int64_t size_bytes() const;
  // The roots of the file's scene: the one in `scene`, else the first, else all nodes that are no children.
  StatusOr<std::vector<int64_t>> RootNodes() const;
  int64_t NodeCount() const;
  StatusOr<GltfNode> Node(int64_t index, const std::string& location) const;
  // `label_attribute`: the vertex attribute that GltfPrimitive::labels refers to; empty: none.
  StatusOr<std::vector<GltfPrimitive>> Primitives(int64_t mesh, const std::string& label_attribute,
                                                  const std::string& location) const;
  StatusOr<std::string> MaterialName(int64_t index, const std::string& location) const;
  // `type`: "SCALAR" or "VEC3". Loads the buffer at the first use.
  StatusOr<GltfValues> Values(int64_t accessor, std::string_view type, const std::string& location);

 private:
  struct Impl;
  explicit GltfDocument(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera
