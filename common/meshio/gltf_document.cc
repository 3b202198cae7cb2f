#include "common/meshio/gltf_document.h"

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <span>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "common/base/json_bounds.h"
#include "common/meshio/text_words.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

using Json = nlohmann::json;

constexpr std::string_view kGlbMagic = "glTF";
constexpr size_t kGlbHeaderBytes = 12, kChunkHeaderBytes = 8;
constexpr uint32_t kJsonChunk = 0x4e4f534a, kBinaryChunk = 0x004e4942;
constexpr int64_t kMaxBufferBytes = std::numeric_limits<uint32_t>::max();  // of all other files, as in GLB
constexpr int64_t kMaxJsonValues = 4'000'000;                              // bounds the memory of the parsed JSON

// Extensions that do not change the surface, or that are applied (KHR_mesh_quantization).
constexpr std::array<std::string_view, 9> kKnownExtensions = {
    "KHR_mesh_quantization", "KHR_texture_transform",   "KHR_texture_basisu",
    "EXT_texture_webp",      "EXT_texture_avif",        "KHR_lights_punctual",
    "EXT_mesh_features",     "EXT_structural_metadata", "EXT_instance_features"};

constexpr char kUncompressed[] = "vertices without compression: export again without Draco and meshopt";
constexpr char kBeside[] = "a file beside this one, or below its folder";

bool IsCompression(std::string_view extension) {
  return extension.find("draco") != std::string_view::npos || extension.find("meshopt") != std::string_view::npos;
}

// The value of a key of an object; null if there is none.
const Json* Member(const Json& object, const std::string& key) {
  if (!object.is_object()) return nullptr;
  const auto found = object.find(key);
  return found == object.end() ? nullptr : &*found;
}

size_t SizeOf(const Json* list) { return list != nullptr && list->is_array() ? list->size() : 0; }

std::string TextOf(const Json* value) {
  if (value == nullptr) return "nothing";
  if (value->is_structured()) return absl::StrCat(value->is_array() ? "a list of " : "an object of ", value->size());
  return Quoted(value->dump(-1, ' ', true, Json::error_handler_t::replace));
}

int64_t ComponentBytes(int64_t type) {
  switch (type) {
    case 5120:
    case 5121:
      return 1;
    case 5122:
    case 5123:
      return 2;
    case 5125:
    case 5126:
      return 4;
    default:
      return 0;
  }
}

// Replaces %20 by a blank, and so on.
std::string WithoutEscapes(const std::string& uri) {
  std::string text;
  for (size_t k = 0; k < uri.size(); ++k) {
    const bool escaped = uri[k] == '%' && k + 2 < uri.size() &&
                         absl::ascii_isxdigit(static_cast<uint8_t>(uri[k + 1])) &&
                         absl::ascii_isxdigit(static_cast<uint8_t>(uri[k + 2]));
    text += escaped ? absl::HexStringToBytes(uri.substr(k + 1, 2)) : uri.substr(k, 1);
    if (escaped) k += 2;
  }
  return text;
}

}  // namespace

struct GltfDocument::Impl {
  const std::string& bytes;
  std::string name, folder;
  Json root;
  std::string_view binary_chunk;
  std::map<int64_t, std::string> buffers;  // loaded ones
  int64_t file_bytes = 0;                  // read from other files

  Status Error(const std::string& location, const std::string& found, const std::string& expected) const {
    return InputError(name, location, found, expected);
  }

  // Finds the chunks of a GLB; `text` becomes its JSON.
  Status OpenBinary(std::string_view& text);
  Status CheckExtensions() const;

  // The whole number from 0 on at a key; `absent` if there is none. Some writers write 3 as 3.0.
  StatusOr<int64_t> Number(const Json& object, const char* key, const std::string& location, int64_t absent) const {
    const Json* const value = Member(object, key);
    if (value == nullptr) return absent;
    const double number = value->is_number() ? value->get<double>() : -1;
    if (number >= 0 && number <= 0x1p53 && number == std::floor(number)) return static_cast<int64_t>(number);
    return Error(absl::StrCat(location, ".", key), TextOf(value), "a whole number from 0 on");
  }

  // Reads finite numbers at a key into `numbers`, which stays as it is if there is no such key.
  Status Numbers(const Json& object, const char* key, const std::string& location, std::span<double> numbers) const {
    const Json* const list = Member(object, key);
    if (list == nullptr) return absl::OkStatus();
    bool good = SizeOf(list) == numbers.size();
    for (size_t k = 0; good && k < numbers.size(); ++k) {
      good = list->at(k).is_number() && std::isfinite(list->at(k).get<double>());
      if (good) numbers[k] = list->at(k).get<double>();
    }
    if (good) return absl::OkStatus();
    return Error(absl::StrCat(location, ".", key), TextOf(list), absl::StrCat(numbers.size(), " finite numbers"));
  }

  StatusOr<std::vector<int64_t>> Indices(const Json* list, const std::string& location) const {
    std::vector<int64_t> indices;
    for (size_t k = 0; k < SizeOf(list); ++k) {
      const Json& index = list->at(k);
      if (!index.is_number_unsigned() || index.get<uint64_t>() > uint64_t{std::numeric_limits<int32_t>::max()}) {
        return Error(absl::StrCat(location, "[", k, "]"), TextOf(&index), "an index");
      }
      indices.push_back(static_cast<int64_t>(index.get<uint64_t>()));
    }
    return indices;
  }

  // The object of an array at the top of the file.
  StatusOr<const Json*> Element(const char* array, int64_t index, const std::string& location) const {
    const Json* const list = Member(root, array);
    const auto size = static_cast<int64_t>(SizeOf(list));
    if (index >= 0 && index < size && list->at(static_cast<size_t>(index)).is_object()) {
      return &list->at(static_cast<size_t>(index));
    }
    return Error(location, index < 0 ? std::string("no index") : absl::StrCat("index ", index),
                 absl::StrCat("one of the ", size, " objects of \"", array, "\""));
  }

  // The bytes of a buffer: the binary chunk, a data URI, or a file beside this one.
  StatusOr<std::string_view> Buffer(int64_t index, const std::string& location);
  StatusOr<std::string> Fetch(const std::string& uri, int64_t size, const std::string& location);
  // The part of a buffer that a view shows, and its stride (0: none given).
  StatusOr<std::pair<std::string_view, int64_t>> View(int64_t index, const std::string& location);
};

Status GltfDocument::Impl::OpenBinary(std::string_view& text) {
  uint32_t header[3] = {};  // magic, version, length
  if (bytes.size() < kGlbHeaderBytes) return Error("byte 0", absl::StrCat(bytes.size(), " bytes"), "a header");
  std::memcpy(header, bytes.data(), sizeof(header));
  if (header[1] != 2) return Error("byte 4", absl::StrCat("version ", header[1]), "2: export as glTF 2.0");
  if (header[2] > bytes.size()) {
    return Error("byte 8", absl::StrCat("a length of ", header[2], " bytes in a file of ", bytes.size()),
                 "the whole file: it is cut");
  }
  text = {};
  size_t at = kGlbHeaderBytes;
  for (int chunk = 0; at + kChunkHeaderBytes <= header[2]; ++chunk) {
    uint32_t part[2] = {};  // length, type
    std::memcpy(part, bytes.data() + at, sizeof(part));
    const size_t room = header[2] - at - kChunkHeaderBytes;
    if (part[0] > room) {
      return Error(absl::StrCat("byte ", at), absl::StrCat("a chunk of ", part[0], " bytes"),
                   absl::StrCat("at most ", room, " bytes"));
    }
    const std::string_view content(bytes.data() + at + kChunkHeaderBytes, part[0]);
    if (chunk == 0 && part[1] == kJsonChunk) text = content;
    if (chunk == 1 && part[1] == kBinaryChunk) binary_chunk = content;
    at += kChunkHeaderBytes + part[0];
  }
  if (text.empty()) return Error("byte 12", "no JSON", "a chunk of JSON");
  return absl::OkStatus();
}

Status GltfDocument::Impl::CheckExtensions() const {
  const Json* const required = Member(root, "extensionsRequired");
  for (size_t k = 0; k < SizeOf(required); ++k) {
    const Json& word = required->at(k);
    const std::string extension = word.is_string() ? word.get<std::string>() : "";
    if (extension.starts_with("KHR_materials_") ||
        std::find(kKnownExtensions.begin(), kKnownExtensions.end(), extension) != kKnownExtensions.end()) {
      continue;
    }
    return Error("extensionsRequired", Quoted(extension),
                 IsCompression(extension) ? kUncompressed : "a file that does not need it: export again without it");
  }
  return absl::OkStatus();
}

StatusOr<std::string_view> GltfDocument::Impl::Buffer(int64_t index, const std::string& location) {
  if (const auto found = buffers.find(index); found != buffers.end()) return std::string_view(found->second);
  TESSERA_ASSIGN_OR_RETURN(const Json* const buffer, Element("buffers", index, location));
  const std::string here = absl::StrCat("buffers[", index, "]");
  TESSERA_ASSIGN_OR_RETURN(const int64_t size, Number(*buffer, "byteLength", here, 0));
  const Json* const uri = Member(*buffer, "uri");
  if (uri == nullptr) {
    if (index == 0 && size <= static_cast<int64_t>(binary_chunk.size())) {
      return binary_chunk.substr(0, static_cast<size_t>(size));
    }
    return Error(
        here, absl::StrCat(size, " bytes without a URI"),
        absl::StrCat("a URI, or for buffer 0 at most the ", binary_chunk.size(), " bytes of the binary chunk"));
  }
  TESSERA_ASSIGN_OR_RETURN(std::string content, Fetch(uri->is_string() ? uri->get<std::string>() : "", size, here));
  if (static_cast<int64_t>(content.size()) < size) {
    return Error(here, absl::StrCat(content.size(), " bytes"), absl::StrCat(size, " bytes (byteLength)"));
  }
  return std::string_view(buffers.emplace(index, std::move(content)).first->second);
}

StatusOr<std::string> GltfDocument::Impl::Fetch(const std::string& uri, int64_t size, const std::string& location) {
  constexpr std::string_view kBase64 = ";base64,";
  const std::string here = location + ".uri";
  if (uri.starts_with("data:")) {
    std::string content;
    const size_t at = uri.find(kBase64);
    if (at != std::string::npos && absl::Base64Unescape(uri.substr(at + kBase64.size()), &content)) return content;
    return Error(here, "a damaged data URI", "base64");
  }
  if (folder.empty() || uri.find("://") != std::string::npos) return Error(here, Quoted(uri), kBeside);
  const StatusOr<std::string> path = JoinInside(folder, WithoutEscapes(uri));
  if (!path.ok()) return Error(here, Quoted(uri), kBeside);
  if (size > kMaxBufferBytes - file_bytes) {
    return Error(location, absl::StrCat(size, " bytes"), absl::StrCat("at most ", kMaxBufferBytes, " in all buffers"));
  }
  file_bytes += size;
  return ReadFileRange(*path, 0, size);
}

StatusOr<std::pair<std::string_view, int64_t>> GltfDocument::Impl::View(int64_t index, const std::string& location) {
  TESSERA_ASSIGN_OR_RETURN(const Json* const view, Element("bufferViews", index, location));
  const std::string here = absl::StrCat("bufferViews[", index, "]");
  if (const Json* const extensions = Member(*view, "extensions"); extensions != nullptr && extensions->is_object()) {
    for (const auto& [extension, content] : extensions->items()) {
      if (IsCompression(extension)) return Error(here, Quoted(extension), kUncompressed);
    }
  }
  TESSERA_ASSIGN_OR_RETURN(const int64_t buffer_index, Number(*view, "buffer", here, -1));
  TESSERA_ASSIGN_OR_RETURN(const int64_t offset, Number(*view, "byteOffset", here, 0));
  TESSERA_ASSIGN_OR_RETURN(const int64_t size, Number(*view, "byteLength", here, 0));
  TESSERA_ASSIGN_OR_RETURN(const int64_t stride, Number(*view, "byteStride", here, 0));
  TESSERA_ASSIGN_OR_RETURN(const std::string_view buffer, Buffer(buffer_index, here + ".buffer"));
  const auto available = static_cast<int64_t>(buffer.size());
  if (size > available || offset > available - size) {
    return Error(here, absl::StrCat(size, " bytes from byte ", offset, " on"),
                 absl::StrCat("a part of the buffer's ", available, " bytes"));
  }
  return std::pair(buffer.substr(static_cast<size_t>(offset), static_cast<size_t>(size)), stride);
}

GltfDocument::GltfDocument(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
GltfDocument::~GltfDocument() = default;

StatusOr<std::unique_ptr<GltfDocument>> GltfDocument::Parse(const std::string& bytes, const std::string& name,
                                                            const std::string& folder) {
  std::unique_ptr<Impl> impl(new Impl{bytes, name, folder, {}, {}, {}, 0});
  std::string_view text = bytes;
  if (text.starts_with(kGlbMagic)) TESSERA_RETURN_IF_ERROR(impl->OpenBinary(text));
  const int64_t values = std::count_if(text.begin(), text.end(), [](char c) { return c == ',' || c == ':'; });
  if (values > kMaxJsonValues) {
    return InputError(name, "", absl::StrCat("JSON of more than ", kMaxJsonValues, " values"), "a smaller description");
  }
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth(name, text));
  try {
    impl->root = Json::parse(text);
  } catch (const Json::parse_error& error) {
    return InputError(name, absl::StrCat("byte ", text.data() - bytes.data() + static_cast<int64_t>(error.byte)),
                      "damaged JSON", "a glTF description");
  } catch (const Json::exception&) {  // a number out of range
    return InputError(name, "", "damaged JSON", "a glTF description");
  }
  const Json* const asset = Member(impl->root, "asset");
  const Json* const version = asset == nullptr ? nullptr : Member(*asset, "version");
  if (version == nullptr || !version->is_string() || !version->get<std::string>().starts_with("2.")) {
    return InputError(name, "asset.version", TextOf(version), "2.0: export as glTF 2.0");
  }
  TESSERA_RETURN_IF_ERROR(impl->CheckExtensions());
  return std::unique_ptr<GltfDocument>(new GltfDocument(std::move(impl)));
}

int64_t GltfDocument::size_bytes() const {
  int64_t size = static_cast<int64_t>(impl_->bytes.size());
  if (impl_->folder.empty()) return size;
  const Json* const list = Member(impl_->root, "buffers");
  for (size_t k = 0; k < SizeOf(list); ++k) {
    const StatusOr<int64_t> length = impl_->Number(list->at(k), "byteLength", "", 0);
    if (length.ok() && Member(list->at(k), "uri") != nullptr) size += std::min(*length, kMaxBufferBytes);
  }
  return std::min(size, 2 * kMaxBufferBytes);
}

StatusOr<std::vector<int64_t>> GltfDocument::RootNodes() const {
  const Json& root = impl_->root;
  if (SizeOf(Member(root, "scenes")) > 0) {
    TESSERA_ASSIGN_OR_RETURN(const int64_t index, impl_->Number(root, "scene", "", 0));
    TESSERA_ASSIGN_OR_RETURN(const Json* const scene, impl_->Element("scenes", index, "scene"));
    return impl_->Indices(Member(*scene, "nodes"), absl::StrCat("scenes[", index, "].nodes"));
  }
  std::set<int64_t> roots;
  for (int64_t k = 0; k < NodeCount(); ++k) roots.insert(roots.end(), k);
  for (int64_t k = 0; k < NodeCount(); ++k) {
    const Json* const children = Member(Member(root, "nodes")->at(static_cast<size_t>(k)), "children");
    TESSERA_ASSIGN_OR_RETURN(const std::vector<int64_t> below,
                             impl_->Indices(children, absl::StrCat("nodes[", k, "].children")));
    for (const int64_t child : below) roots.erase(child);
  }
  return std::vector<int64_t>(roots.begin(), roots.end());
}

int64_t GltfDocument::NodeCount() const { return static_cast<int64_t>(SizeOf(Member(impl_->root, "nodes"))); }

StatusOr<GltfNode> GltfDocument::Node(int64_t index, const std::string& location) const {
  TESSERA_ASSIGN_OR_RETURN(const Json* const json, impl_->Element("nodes", index, location));
  const std::string here = absl::StrCat("nodes[", index, "]");
  GltfNode node;
  TESSERA_ASSIGN_OR_RETURN(node.children, impl_->Indices(Member(*json, "children"), here + ".children"));
  TESSERA_ASSIGN_OR_RETURN(node.mesh, impl_->Number(*json, "mesh", here, -1));
  node.has_skin = Member(*json, "skin") != nullptr;
  const Json* const extensions = Member(*json, "extensions");
  node.instances = extensions != nullptr && Member(*extensions, "EXT_mesh_gpu_instancing") != nullptr;
  // The matrix, by columns; or the translation of the rotation (x, y, z, w) of the scale.
  TESSERA_RETURN_IF_ERROR(impl_->Numbers(*json, "matrix", here, {node.parent_from_node.data(), 16}));
  if (Member(*json, "matrix") != nullptr) return node;
  Eigen::Vector3d translation(0, 0, 0), scale(1, 1, 1);
  Eigen::Quaterniond rotation(1, 0, 0, 0);
  TESSERA_RETURN_IF_ERROR(impl_->Numbers(*json, "translation", here, {translation.data(), 3}));
  TESSERA_RETURN_IF_ERROR(impl_->Numbers(*json, "rotation", here, {rotation.coeffs().data(), 4}));
  TESSERA_RETURN_IF_ERROR(impl_->Numbers(*json, "scale", here, {scale.data(), 3}));
  if (std::abs(rotation.norm() - 1) > 1e-3) {
    return impl_->Error(here + ".rotation", absl::StrCat("a quaternion of length ", rotation.norm()),
                        "a unit quaternion");
  }
  node.parent_from_node.topLeftCorner<3, 3>() = rotation.normalized().toRotationMatrix() * scale.asDiagonal();
  node.parent_from_node.topRightCorner<3, 1>() = translation;
  return node;
}

StatusOr<std::vector<GltfPrimitive>> GltfDocument::Primitives(int64_t mesh, const std::string& label_attribute,
                                                              const std::string& location) const {
  TESSERA_ASSIGN_OR_RETURN(const Json* const json, impl_->Element("meshes", mesh, location));
  const Json* const list = Member(*json, "primitives");
  std::vector<GltfPrimitive> primitives;
  for (size_t k = 0; k < SizeOf(list); ++k) {
    const Json& entry = list->at(k);
    GltfPrimitive primitive;
    const std::string here = absl::StrCat("meshes[", mesh, "].primitives[", k, "]");
    primitive.location = here;
    if (const Json* const extensions = Member(entry, "extensions"); extensions != nullptr && extensions->is_object()) {
      for (const auto& [extension, content] : extensions->items()) {
        if (IsCompression(extension)) return impl_->Error(here, Quoted(extension), kUncompressed);
      }
    }
    TESSERA_ASSIGN_OR_RETURN(primitive.mode, impl_->Number(entry, "mode", here, 4));
    TESSERA_ASSIGN_OR_RETURN(primitive.indices, impl_->Number(entry, "indices", here, -1));
    TESSERA_ASSIGN_OR_RETURN(primitive.material, impl_->Number(entry, "material", here, -1));
    const Json* const attributes = Member(entry, "attributes");
    if (attributes == nullptr) return impl_->Error(here, "no attributes", "the attribute POSITION");
    TESSERA_ASSIGN_OR_RETURN(primitive.positions, impl_->Number(*attributes, "POSITION", here, -1));
    if (!label_attribute.empty()) {
      TESSERA_ASSIGN_OR_RETURN(primitive.labels, impl_->Number(*attributes, label_attribute.c_str(), here, -1));
    }
    primitive.has_morph_targets = SizeOf(Member(entry, "targets")) > 0;
    primitives.push_back(std::move(primitive));
  }
  return primitives;
}

StatusOr<std::string> GltfDocument::MaterialName(int64_t index, const std::string& location) const {
  TESSERA_ASSIGN_OR_RETURN(const Json* const material, impl_->Element("materials", index, location));
  const Json* const name = Member(*material, "name");
  if (name != nullptr && name->is_string() && *name != "") return name->get<std::string>();
  return absl::StrCat("material ", index);
}

StatusOr<GltfValues> GltfDocument::Values(int64_t accessor, std::string_view type, const std::string& location) {
  TESSERA_ASSIGN_OR_RETURN(const Json* const json, impl_->Element("accessors", accessor, location));
  const std::string here = absl::StrCat("accessors[", accessor, "]");
  const Json* const found_type = Member(*json, "type");
  if (found_type == nullptr || !found_type->is_string() || found_type->get<std::string>() != type) {
    return impl_->Error(here + ".type", TextOf(found_type), Quoted(type));
  }
  if (Member(*json, "sparse") != nullptr) {
    return impl_->Error(here, "sparse values", "values without \"sparse\": export again without it");
  }
  GltfValues values;
  TESSERA_ASSIGN_OR_RETURN(values.component_type, impl_->Number(*json, "componentType", here, 0));
  const int64_t element_bytes = ComponentBytes(values.component_type) * (type == "VEC3" ? 3 : 1);
  if (element_bytes == 0) {
    return impl_->Error(here + ".componentType", absl::StrCat(values.component_type), "5120 to 5123, 5125 or 5126");
  }
  TESSERA_ASSIGN_OR_RETURN(values.count, impl_->Number(*json, "count", here, 0));
  TESSERA_ASSIGN_OR_RETURN(const int64_t offset, impl_->Number(*json, "byteOffset", here, 0));
  TESSERA_ASSIGN_OR_RETURN(const int64_t view_index, impl_->Number(*json, "bufferView", here, -1));
  TESSERA_ASSIGN_OR_RETURN(const auto view, impl_->View(view_index, here + ".bufferView"));
  const auto [bytes, stride] = view;
  const auto available = static_cast<int64_t>(bytes.size());
  values.stride_bytes = stride == 0 ? element_bytes : stride;
  if (values.count > 0 &&
      (offset > available || available - offset < element_bytes || values.stride_bytes < element_bytes ||
       values.count - 1 > (available - offset - element_bytes) / values.stride_bytes)) {
    return impl_->Error(
        here, absl::StrCat(values.count, " values, ", values.stride_bytes, " bytes apart, from byte ", offset, " on"),
        absl::StrCat("a part of the ", available, " bytes of bufferViews[", view_index, "]"));
  }
  if (values.count > 0) values.data = bytes.data() + offset;
  const Json* const normalized = Member(*json, "normalized");
  values.normalized = normalized != nullptr && normalized->is_boolean() && normalized->get<bool>();
  return values;
}

}  // namespace tessera
