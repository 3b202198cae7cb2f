// Writes glTF 2.0 files for tests, by the definition of the format.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"

namespace tessera {

// Bytes of a buffer and the JSON of its views and accessors, one view an accessor.
class GltfBuffer {
 public:
  // Returns the number of the accessor. `component`: componentType; `type`: "SCALAR" or "VEC3".
  template <class T>
  int Add(const std::vector<T>& values, int component, const std::string& type, const std::string& more = "") {
    while (bytes_.size() % 4 != 0) bytes_ += '\0';
    const size_t size = values.size() * sizeof(T), count = values.size() / (type == "VEC3" ? 3 : 1);
    absl::StrAppend(&views_, accessors_ == 0 ? "" : ",", "{\"buffer\":0,\"byteOffset\":", bytes_.size(),
                    ",\"byteLength\":", size, "}");
    absl::StrAppend(&accessor_json_, accessors_ == 0 ? "" : ",", "{\"bufferView\":", accessors_,
                    ",\"componentType\":", component, ",\"count\":", count, ",\"type\":\"", type, "\"", more, "}");
    bytes_.append(reinterpret_cast<const char*>(values.data()), size);
    return accessors_++;
  }
  int AddPositions(const std::vector<float>& xyz) { return Add(xyz, 5126, "VEC3"); }
  int AddIndices(const std::vector<uint32_t>& indices) { return Add(indices, 5125, "SCALAR"); }

  // The description with `rest` (meshes, nodes, scenes, ...). `uri`: of the buffer; empty: none.
  std::string Json(const std::string& rest, const std::string& uri) const {
    return absl::StrCat("{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{", uri.empty() ? "" : "\"uri\":\"", uri,
                        uri.empty() ? "" : "\",", "\"byteLength\":", bytes_.size(), "}],\"bufferViews\":[", views_,
                        "],\"accessors\":[", accessor_json_, "],", rest, "}");
  }
  const std::string& bytes() const { return bytes_; }

  // A .gltf with the buffer in it.
  std::string Text(const std::string& rest) const {
    return Json(rest, absl::StrCat("data:application/octet-stream;base64,", absl::Base64Escape(bytes_)));
  }
  // A .glb.
  std::string Binary(const std::string& rest) const {
    std::string json = Json(rest, ""), chunk = bytes_;
    while (json.size() % 4 != 0) json += ' ';
    while (chunk.size() % 4 != 0) chunk += '\0';
    return absl::StrCat("glTF", Word(2), Word(28 + json.size() + chunk.size()), Word(json.size()), "JSON", json,
                        Word(chunk.size()), std::string("BIN\0", 4), chunk);
  }

 private:
  static std::string Word(uint64_t value) {
    std::string bytes;
    for (int k = 0; k < 4; ++k) bytes += static_cast<char>((value >> (8 * k)) & 255);
    return bytes;
  }

  std::string bytes_, views_, accessor_json_;
  int accessors_ = 0;
};

}  // namespace tessera
