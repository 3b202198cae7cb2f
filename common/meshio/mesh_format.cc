#include "common/meshio/mesh_format.h"

#include <algorithm>
#include <memory>
#include <optional>

#include "absl/strings/str_cat.h"
#include "common/meshio/byte_source.h"
#include "common/meshio/foreign_content.h"
#include "common/meshio/gltf.h"
#include "common/meshio/obj.h"
#include "common/meshio/ply.h"

namespace tessera {
namespace {

constexpr MeshFormat kFormats[] = {
    {"PLY", IsPly, PlyHasLabels, ReadPly, StreamPly, PlyHasMoreFaces},
    {"OBJ", IsObj, ObjHasLabels, ReadObj, StreamObj, ObjHasMoreFaces},
    {"glTF", IsGltf, GltfHasLabels, ReadGltf, StreamGltf, GltfHasMoreFaces},
};

constexpr int64_t kHeadBytes = 4096;

std::string Names() {
  std::string names;
  for (const MeshFormat& format : kFormats)
    absl::StrAppend(&names, names.empty() ? "" : ", ", std::string(format.name));
  return names;
}

StatusOr<const MeshFormat*> FormatOfFile(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const std::unique_ptr<ByteSource> source, ByteSource::Open(path));
  const auto size = static_cast<size_t>(std::min(kHeadBytes, source->size_bytes()));
  const char* const bytes = source->Peek(size);
  TESSERA_RETURN_IF_ERROR(source->status());
  const std::string_view head(bytes, bytes == nullptr ? 0 : size);
  // OBJ has no signature, so others come first.
  const std::optional<ForeignContent> foreign =
      IsPly(head) ? std::nullopt : RecogniseForeignContent(head, source->size_bytes());
  if (foreign) {
    return InputError(path, "first bytes", foreign->name,
                      absl::StrCat("a mesh file (", Names(), "): ", foreign->remedy));
  }
  for (const MeshFormat& format : kFormats) {
    if (format.matches(head)) return &format;
  }
  return InputError(path, "first bytes", head.empty() ? "an empty file" : "no known mesh format",
                    absl::StrCat("a mesh file (", Names(), ")"));
}

}  // namespace

StatusOr<MeshContent> ReadMesh(const std::string& path, const MeshReadOptions& options) {
  TESSERA_ASSIGN_OR_RETURN(const MeshFormat* const format, FormatOfFile(path));
  return format->read(path, options);
}

bool HeadHasLabels(std::string_view head, const std::optional<std::string>& label_property) {
  for (const MeshFormat& format : kFormats) {
    if (format.matches(head)) return format.has_labels(head, label_property);
  }
  return false;
}

Status StreamMesh(const std::string& path, const MeshReadOptions& options, MeshSink* sink) {
  TESSERA_ASSIGN_OR_RETURN(const MeshFormat* const format, FormatOfFile(path));
  return format->stream(path, options, sink);
}

StatusOr<bool> HasMoreFaces(const std::string& path, int64_t max_faces) {
  TESSERA_ASSIGN_OR_RETURN(const MeshFormat* const format, FormatOfFile(path));
  return format->has_more_faces(path, max_faces);
}

}  // namespace tessera
