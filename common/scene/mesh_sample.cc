#include "common/scene/mesh_sample.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <optional>
#include <string>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "common/meshio/ply_header.h"

namespace tessera {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr int64_t kFacesOfRun = 16;              // neighbours in the file often share vertices
constexpr int64_t kMostBytesAtOnce = 128 << 10;  // of vertices between the first and the last of a run

// The offset of each property with a role, in a row of fixed size.
struct RowLayout {
  int64_t bytes = 0;
  std::optional<int64_t> x, y, z, indices;
  PlyType position = PlyType::kFloat32, index = PlyType::kInt32, count = PlyType::kUint8;
};

// None if the rows have no fixed size. Takes a list of indices for one of 3.
std::optional<RowLayout> LayoutOf(const PlyElement& element) {
  RowLayout layout;
  for (const PlyProperty& property : element.properties) {
    if (property.role == PlyRole::kX) layout.x = layout.bytes;
    if (property.role == PlyRole::kY) layout.y = layout.bytes;
    if (property.role == PlyRole::kZ) layout.z = layout.bytes;
    if (property.role == PlyRole::kX) layout.position = property.type;
    if ((property.role == PlyRole::kY || property.role == PlyRole::kZ) && property.type != layout.position) {
      return std::nullopt;
    }
    if (property.role == PlyRole::kIndices) {
      layout.indices = layout.bytes;
      layout.index = property.type;
      layout.count = property.count_type;
      layout.bytes += PlyTypeBytes(property.count_type) + 3 * PlyTypeBytes(property.type);
    } else if (property.is_list) {
      return std::nullopt;
    } else {
      layout.bytes += PlyTypeBytes(property.type);
    }
  }
  return layout;
}

int64_t IntegerAt(const char* at, PlyType type) {
  uint64_t value = 0;
  std::memcpy(&value, at, PlyTypeBytes(type));
  return static_cast<int64_t>(value);  // counts and indices are not negative; a negative one is too large below
}

double NumberAt(const char* at, PlyType type) {
  if (type == PlyType::kFloat64) {
    double value = 0;
    std::memcpy(&value, at, sizeof(value));
    return value;
  }
  float value = 0;
  std::memcpy(&value, at, sizeof(value));
  return value;
}

class Sampler {
 public:
  Sampler(const AllowedFile& file, std::string name, const PlyElement& vertex, const RowLayout& vertices,
          const PlyElement& face, const RowLayout& faces, int64_t begin)
      : file_(file),
        name_(std::move(name)),
        vertices_(vertices),
        faces_(faces),
        vertex_count_(vertex.count),
        face_count_(face.count),
        vertices_begin_(begin),
        faces_begin_(begin + vertex.count * vertices.bytes) {}

  // False if a face is no triangle.
  StatusOr<bool> Take(const Frame& frame, TriangleMesh* mesh) const {
    const int64_t runs = std::min((face_count_ + kFacesOfRun - 1) / kFacesOfRun, kSampledFaces / kFacesOfRun);
    for (int64_t run = 0; run < runs; ++run) {
      const int64_t first = run * face_count_ / runs, next = (run + 1) * face_count_ / runs;
      const int64_t count = std::min(kFacesOfRun, next - first);
      TESSERA_ASSIGN_OR_RETURN(const std::string rows, Read(faces_begin_ + first * faces_.bytes, count * faces_.bytes));
      std::vector<int64_t> corners;
      for (int64_t f = 0; f < count; ++f) {
        const char* const row = rows.data() + f * faces_.bytes + *faces_.indices;
        if (IntegerAt(row, faces_.count) != 3) return false;
        for (int k = 0; k < 3; ++k) {
          const int64_t index =
              IntegerAt(row + PlyTypeBytes(faces_.count) + k * PlyTypeBytes(faces_.index), faces_.index);
          if (index < 0 || index >= vertex_count_) {
            return InputError(name_, absl::StrCat("face ", first + f), absl::StrCat("vertex ", index),
                              absl::StrCat("0 to ", vertex_count_ - 1));
          }
          corners.push_back(index);
        }
      }
      TESSERA_RETURN_IF_ERROR(AddCorners(corners, frame, mesh));
    }
    return true;
  }

 private:
  StatusOr<std::string> Read(int64_t offset, int64_t bytes) const {
    TESSERA_ASSIGN_OR_RETURN(std::string read, file_.Read(offset, bytes));
    if (static_cast<int64_t>(read.size()) == bytes) return read;
    return InputError(name_, absl::StrCat("offset ", offset), "the end of the file", absl::StrCat(bytes, " bytes"));
  }

  Status AddCorners(const std::vector<int64_t>& corners, const Frame& frame, TriangleMesh* mesh) const {
    const auto [least, most] = std::minmax_element(corners.begin(), corners.end());
    const int64_t span = (*most - *least + 1) * vertices_.bytes;
    std::string together;
    if (span <= kMostBytesAtOnce) {
      TESSERA_ASSIGN_OR_RETURN(together, Read(vertices_begin_ + *least * vertices_.bytes, span));
    }
    for (size_t i = 0; i < corners.size(); ++i) {
      std::string alone;
      const char* row = together.data() + (corners[i] - *least) * vertices_.bytes;
      if (together.empty()) {
        TESSERA_ASSIGN_OR_RETURN(alone, Read(vertices_begin_ + corners[i] * vertices_.bytes, vertices_.bytes));
        row = alone.data();
      }
      const Eigen::Vector3d p(NumberAt(row + *vertices_.x, vertices_.position),
                              NumberAt(row + *vertices_.y, vertices_.position),
                              NumberAt(row + *vertices_.z, vertices_.position));
      if (!p.allFinite()) {
        return InputError(name_, absl::StrCat("vertex ", corners[i]), "a position that is not finite", "numbers");
      }
      if (i % 3 == 0) {
        const auto next = static_cast<uint32_t>(mesh->vertices.size());
        mesh->faces.push_back({next, next + 1, next + 2});
      }
      mesh->vertices.push_back(frame.LocalFromScene(p));
    }
    return absl::OkStatus();
  }

  const AllowedFile& file_;
  const std::string name_;
  const RowLayout vertices_, faces_;
  const int64_t vertex_count_, face_count_, vertices_begin_, faces_begin_;
};

}  // namespace

StatusOr<MeshSample> SampleSceneMesh(const SceneDescription& scene, const AllowedFiles& allowed) {
  MeshSample sample;
  sample.faces = -1;
  const std::string path = absl::StrCat(scene.folder, "/", scene.mesh_path);
  TESSERA_ASSIGN_OR_RETURN(const AllowedFile file, allowed.Open(path));
  TESSERA_ASSIGN_OR_RETURN(const std::string head, file.Read(0, 4));
  if (!absl::StartsWith(head, "ply")) return sample;
  TESSERA_ASSIGN_OR_RETURN(const auto source, ByteSource::Open(file.path()));
  MeshReadOptions options;
  options.label_property = "";
  TESSERA_ASSIGN_OR_RETURN(const PlyHeader header, ReadPlyHeader(*source, path, options));
  sample.faces = header.face_count;
  const bool simple = header.format == PlyFormat::kBinaryLittleEndian && header.elements.size() >= 2 &&
                      header.elements[0].kind == PlyElementKind::kVertex &&
                      header.elements[1].kind == PlyElementKind::kFace;
  if (!simple) return sample;
  const auto vertices = LayoutOf(header.elements[0]), faces = LayoutOf(header.elements[1]);
  if (!vertices || !faces || !vertices->x || !vertices->y || !vertices->z || !faces->indices) return sample;
  const Sampler sampler(file, path, header.elements[0], *vertices, header.elements[1], *faces, source->offset_bytes());
  TESSERA_ASSIGN_OR_RETURN(const bool triangles, sampler.Take(scene.frame, &sample.mesh));
  if (!triangles) sample.mesh = TriangleMesh();
  return sample;
}

}  // namespace tessera
