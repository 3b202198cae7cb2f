#include <fcntl.h>
#include <unistd.h>

#include <bit>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <limits>

#include "absl/strings/str_cat.h"
#include "common/meshio/ply.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr size_t kBufferBytes = size_t{1} << 20;

// Writes a new file through a buffer; removes it unless it was finished.
class NewFile {
 public:
  explicit NewFile(const std::string& path)
      : path_(path), fd_(open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666)) {
    if (fd_ < 0) status_ = absl::ErrnoToStatus(errno, path_);
    buffer_.reserve(kBufferBytes);
  }
  ~NewFile() {
    if (fd_ < 0) return;
    close(fd_);
    unlink(path_.c_str());
  }
  NewFile(const NewFile&) = delete;
  NewFile& operator=(const NewFile&) = delete;

  void Add(const void* data, size_t size) {
    if (buffer_.size() + size > kBufferBytes) Flush();
    buffer_.append(static_cast<const char*>(data), size);
  }
  bool ok() const { return status_.ok(); }

  // Makes the bytes durable and keeps the file.
  Status Finish() {
    Flush();
    if (ok() && fsync(fd_) != 0) Fail();
    if (!ok()) return status_;
    const int fd = fd_;
    fd_ = -1;
    if (close(fd) != 0) {
      Fail();
      unlink(path_.c_str());
    }
    return status_;
  }

 private:
  void Fail() { status_ = absl::ErrnoToStatus(errno, path_); }

  void Flush() {
    size_t done = 0;
    while (ok() && done < buffer_.size()) {
      const ssize_t wrote = write(fd_, buffer_.data() + done, buffer_.size() - done);
      if (wrote < 0 && errno != EINTR) Fail();
      if (wrote > 0) done += static_cast<size_t>(wrote);
    }
    buffer_.clear();
  }

  std::string path_;
  int fd_;
  std::string buffer_;
  Status status_;
};

Status CheckMesh(const TriangleMesh& mesh, const PlyWriteOptions& options) {
  const size_t faces = mesh.faces.size();
  if (!mesh.labels.empty() && mesh.labels.size() != faces) {
    return absl::InvalidArgumentError(absl::StrCat("a mesh of ", faces, " faces has ", mesh.labels.size(), " labels"));
  }
  if (!options.face_confidence.empty() && options.face_confidence.size() != faces) {
    return absl::InvalidArgumentError(
        absl::StrCat("a mesh of ", faces, " faces has ", options.face_confidence.size(), " confidences"));
  }
  if (!options.input_face.empty() && options.input_face.size() != faces) {
    return absl::InvalidArgumentError(
        absl::StrCat("a mesh of ", faces, " faces has ", options.input_face.size(), " input faces"));
  }
  for (size_t v = 0; v < mesh.vertices.size(); ++v) {
    if (!mesh.vertices[v].allFinite()) {
      return absl::InvalidArgumentError(absl::StrCat("vertex ", v, " of the mesh is not finite"));
    }
  }
  return absl::OkStatus();
}

}  // namespace

Status WritePly(const std::string& path, const TriangleMesh& mesh, const PlyWriteOptions& options) {
  TESSERA_RETURN_IF_ERROR(CheckMesh(mesh, options));
  const bool has_labels = !mesh.labels.empty();
  const bool has_colors = has_labels && !options.label_colors_rgb.empty();
  const bool has_confidence = !options.face_confidence.empty();
  const bool has_input_face = !options.input_face.empty();
  // int is what most programs know; its range is left only where it must be.
  const char* index_type = mesh.vertices.size() > std::numeric_limits<int32_t>::max() ? "uint" : "int";
  std::string header = absl::StrCat("ply\nformat binary_little_endian 1.0\nelement vertex ", mesh.vertices.size(),
                                    "\nproperty double x\nproperty double y\nproperty double z\nelement face ",
                                    mesh.faces.size(), "\nproperty list uchar ", index_type, " vertex_indices\n");
  if (has_labels) header += "property int label\n";
  if (has_colors) header += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  if (has_confidence) header += "property float confidence\n";
  if (has_input_face) header += "property int input_face\n";
  header += "end_header\n";

  const std::string temporary = absl::StrCat(path, ".tmp-", getpid());
  NewFile file(temporary);
  file.Add(header.data(), header.size());
  for (const Eigen::Vector3d& vertex : mesh.vertices) {
    if (!file.ok()) break;
    file.Add(vertex.data(), 3 * sizeof(double));
  }
  for (size_t f = 0; f < mesh.faces.size() && file.ok(); ++f) {
    char record[1 + 3 * 4 + 4 + 3 + 4 + 4];
    char* at = record;
    const auto put = [&at](const void* data, size_t size) {
      std::memcpy(at, data, size);
      at += size;
    };
    const uint8_t corners = 3;
    put(&corners, 1);
    put(mesh.faces[f].data(), sizeof(Triangle));
    if (has_labels) put(&mesh.labels[f], sizeof(int32_t));
    if (has_colors) {
      const auto label = static_cast<size_t>(mesh.labels[f]);
      const std::array<uint8_t, 3> black{};
      put(mesh.labels[f] >= 0 && label < options.label_colors_rgb.size() ? options.label_colors_rgb[label].data()
                                                                         : black.data(),
          3);
    }
    if (has_confidence) put(&options.face_confidence[f], sizeof(float));
    if (has_input_face) {
      const auto input_face = static_cast<int32_t>(options.input_face[f]);
      put(&input_face, sizeof(input_face));
    }
    file.Add(record, static_cast<size_t>(at - record));
  }
  TESSERA_RETURN_IF_ERROR(file.Finish());
  const Status renamed = RenameDurably(temporary, path);
  if (!renamed.ok()) unlink(temporary.c_str());
  return renamed;
}

}  // namespace tessera
