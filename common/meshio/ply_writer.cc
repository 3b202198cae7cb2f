#include <unistd.h>

#include <bit>
#include <cstdio>
#include <cstring>
#include <limits>

#include "absl/strings/str_cat.h"
#include "common/meshio/ply.h"
#include "common/storage/files.h"
#include "common/storage/new_file.h"
#include "common/storage/temporary_name.h"

namespace tessera {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr char kColorProperties[] = "property uchar red\nproperty uchar green\nproperty uchar blue\n";

Status CheckMesh(const TriangleMesh& mesh, const PlyWriteOptions& options) {
  for (const auto& [values, what] :
       {std::pair(mesh.labels.size(), "labels"), std::pair(options.face_confidence.size(), "confidences"),
        std::pair(options.input_face.size(), "input faces")}) {
    if (values == 0 || values == mesh.faces.size()) continue;
    return absl::InvalidArgumentError(
        absl::StrCat("mesh has ", values, " ", what, ", expected one per face: ", mesh.faces.size()));
  }
  for (size_t v = 0; v < mesh.vertices.size(); ++v) {
    if (!mesh.vertices[v].allFinite()) {
      return absl::InvalidArgumentError(absl::StrCat("vertex ", v, " of the mesh has coordinates that are not finite"));
    }
  }
  return absl::OkStatus();
}

}  // namespace

struct PlyStream::Impl {
  Impl(const std::string& final_path, const std::string& while_written)
      : path(final_path), temporary(while_written), file(while_written) {}
  std::string path, temporary;
  NewFile file;
  PlyLayout layout;
  int64_t vertices = 0, faces = 0;  // written so far
};

PlyStream::PlyStream(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
PlyStream::PlyStream(PlyStream&&) noexcept = default;
PlyStream& PlyStream::operator=(PlyStream&&) noexcept = default;
PlyStream::~PlyStream() = default;

StatusOr<PlyStream> PlyStream::Create(const std::string& path, const PlyLayout& layout) {
  // Most programs expect int indices; use uint only if there are too many vertices.
  const char* index_type = layout.vertices > std::numeric_limits<int32_t>::max() ? "uint" : "int";
  std::string header = absl::StrCat("ply\nformat binary_little_endian 1.0\nelement vertex ", layout.vertices,
                                    "\nproperty double x\nproperty double y\nproperty double z\n");
  if (layout.has_vertex_colors) header += kColorProperties;
  if (layout.has_vertex_labels) header += "property float scalar_label\n";
  absl::StrAppend(&header, "element face ", layout.faces, "\nproperty list uchar ", index_type, " vertex_indices\n");
  if (layout.has_labels) header += "property int label\n";
  if (layout.has_labels && !layout.label_colors_rgb.empty()) header += kColorProperties;
  if (layout.has_confidence) header += "property float confidence\n";
  if (layout.has_input_face) header += "property int input_face\n";
  if (layout.has_outdated) header += "property uchar outdated\n";
  header += "end_header\n";
  auto impl = std::make_unique<Impl>(path, TemporaryBeside(path));
  impl->layout = layout;
  impl->file.Add(header.data(), header.size());
  return PlyStream(std::move(impl));
}

void PlyStream::AddVertex(const Eigen::Vector3d& position, const std::array<uint8_t, 3>& color_rgb, int32_t label) {
  ++impl_->vertices;
  impl_->file.Add(position.data(), 3 * sizeof(double));
  if (impl_->layout.has_vertex_colors) impl_->file.Add(color_rgb.data(), color_rgb.size());
  if (!impl_->layout.has_vertex_labels) return;
  const auto value = static_cast<float>(label);
  impl_->file.Add(&value, sizeof(value));
}

void PlyStream::AddFace(const PlyFace& face) {
  const PlyLayout& layout = impl_->layout;
  ++impl_->faces;
  char record[1 + 3 * 4 + 4 + 3 + 4 + 4 + 1];
  char* at = record;
  const auto put = [&at](const void* data, size_t size) {
    std::memcpy(at, data, size);
    at += size;
  };
  const uint8_t corners = 3;
  put(&corners, 1);
  put(face.vertices.data(), sizeof(Triangle));
  if (layout.has_labels) put(&face.label, sizeof(int32_t));
  if (layout.has_labels && !layout.label_colors_rgb.empty()) {
    const auto label = static_cast<size_t>(face.label);
    const std::array<uint8_t, 3> black{};
    put(face.label >= 0 && label < layout.label_colors_rgb.size() ? layout.label_colors_rgb[label].data()
                                                                  : black.data(),
        3);
  }
  if (layout.has_confidence) put(&face.confidence, sizeof(float));
  if (layout.has_input_face) {
    const auto input_face = static_cast<int32_t>(face.input_face);
    put(&input_face, sizeof(input_face));
  }
  if (layout.has_outdated) {
    const uint8_t outdated = face.outdated ? 1 : 0;
    put(&outdated, 1);
  }
  impl_->file.Add(record, static_cast<size_t>(at - record));
}

Status PlyStream::Finish() {
  Impl& stream = *impl_;
  if (stream.vertices != stream.layout.vertices || stream.faces != stream.layout.faces) {
    return absl::InternalError(absl::StrCat(stream.path, ": found ", stream.vertices, " vertices and ", stream.faces,
                                            " faces, expected ", stream.layout.vertices, " and ", stream.layout.faces));
  }
  TESSERA_RETURN_IF_ERROR(stream.file.Finish());
  const Status renamed = RenameDurably(stream.temporary, stream.path);
  if (!renamed.ok()) unlink(stream.temporary.c_str());
  return renamed;
}

Status WritePly(const std::string& path, const TriangleMesh& mesh, const PlyWriteOptions& options) {
  TESSERA_RETURN_IF_ERROR(CheckMesh(mesh, options));
  PlyLayout layout;
  layout.vertices = static_cast<int64_t>(mesh.vertices.size());
  layout.faces = static_cast<int64_t>(mesh.faces.size());
  layout.has_labels = !mesh.labels.empty();
  layout.label_colors_rgb = options.label_colors_rgb;
  layout.has_confidence = !options.face_confidence.empty();
  layout.has_input_face = !options.input_face.empty();
  TESSERA_ASSIGN_OR_RETURN(PlyStream stream, PlyStream::Create(path, layout));
  for (const Eigen::Vector3d& vertex : mesh.vertices) stream.AddVertex(vertex);
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    PlyFace face = {mesh.faces[f]};
    if (layout.has_labels) face.label = mesh.labels[f];
    if (layout.has_confidence) face.confidence = options.face_confidence[f];
    if (layout.has_input_face) face.input_face = options.input_face[f];
    stream.AddFace(face);
  }
  return stream.Finish();
}

}  // namespace tessera
