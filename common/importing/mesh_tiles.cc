#include "common/importing/mesh_tiles.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/printable.h"
#include "common/importing/rim_welder.h"
#include "common/meshio/byte_source.h"
#include "common/meshio/mesh_format.h"
#include "common/meshio/ply.h"
#include "common/meshio/text_words.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

constexpr double kTileReadingShare = 0.9;  // of the progress; the rest is writing
constexpr int64_t kMeshElementsPerCheck = 1 << 20;
constexpr size_t kMaxLabelValues = 1000;
constexpr size_t kMaxListedMaterials = 30;  // of materials without a class, in a message

struct SpooledFace {
  Triangle vertices;
  int32_t label = -1;  // as read: the number of a material, or the value of a property
};

// Values in a temporary file, written and then read in their order.
template <class T>
class Spool {
 public:
  static StatusOr<Spool> Create(const std::string& path) {
    Spool spool;
    spool.path_ = path;
    spool.fd_.reset(new int(open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600)));
    if (*spool.fd_ < 0) return FileError(errno, path);
    return spool;
  }
  void Add(const T& value) {
    buffer_.append(reinterpret_cast<const char*>(&value), sizeof(T));
    if (buffer_.size() >= kBufferBytes) Flush();
  }
  // The first error of the disk.
  const Status& status() const { return status_; }
  // Calls `use` with all values.
  Status Read(const TaskControl& control, const std::function<void(const T&)>& use) {
    Flush();
    TESSERA_RETURN_IF_ERROR(status_);
    TESSERA_ASSIGN_OR_RETURN(const std::unique_ptr<ByteSource> source, ByteSource::Open(path_));
    T value;
    for (int64_t count = 0;; ++count) {
      if (count % kMeshElementsPerCheck == 0) TESSERA_RETURN_IF_ERROR(control.Check());
      const char* const bytes = source->Peek(sizeof(T));
      if (bytes == nullptr) return source->status();
      std::memcpy(static_cast<void*>(&value), bytes, sizeof(T));
      source->Advance(sizeof(T));
      use(value);
    }
  }

 private:
  static constexpr size_t kBufferBytes = size_t{1} << 20;
  struct Close {
    void operator()(int* fd) const {
      if (*fd >= 0) close(*fd);
      delete fd;
    }
  };
  void Flush() {
    if (status_.ok()) status_ = WriteAll(*fd_, buffer_, path_);
    buffer_.clear();
  }

  std::string path_, buffer_;
  std::unique_ptr<int, Close> fd_;
  Status status_;
};

class TileMerger {
 public:
  TileMerger(const MeshSource& source, const MergeOptions& options, Warnings* warnings)
      : source_(source), options_(options), warnings_(warnings), welder_(options.weld_m) {}

  StatusOr<MergedMesh> Merge(const std::string& out_ply) {
    const std::string folder = std::filesystem::path(AbsolutePath(out_ply)).parent_path().string();
    TESSERA_ASSIGN_OR_RETURN(const TempFolder spools, TempFolder::Create(folder, ".mesh-"));
    TESSERA_ASSIGN_OR_RETURN(auto vertices, Spool<Eigen::Vector3d>::Create(spools.path() + "/vertices"));
    TESSERA_ASSIGN_OR_RETURN(auto faces, Spool<SpooledFace>::Create(spools.path() + "/faces"));
    vertices_ = &vertices;
    faces_ = &faces;
    TESSERA_RETURN_IF_ERROR(ReadTiles());
    TESSERA_RETURN_IF_ERROR(ChooseClasses());
    TESSERA_RETURN_IF_ERROR(Write(out_ply));
    return std::move(merged_);
  }

 private:
  Status ReadTiles() {
    Faults faults;
    const auto tiles = static_cast<double>(source_.files.size());
    for (size_t tile = 0; tile < source_.files.size(); ++tile) {
      TESSERA_RETURN_IF_ERROR(options_.control.Check());
      options_.control.Report(kTileReadingShare * static_cast<double>(tile) / tiles,
                              absl::StrCat("mesh file ", tile + 1, " of ", source_.files.size()));
      const Status added = AddTile(tile);
      if (!added.ok() && !absl::IsInvalidArgument(added)) return added;
      faults.Add(added);  // the faults of the other tiles are of use too
    }
    return faults.ToStatus();
  }

  Status AddTile(size_t tile) {
    MeshReadOptions read;
    read.label_property = options_.labels == LabelSource::kProperty ? options_.label_property : "";
    read.label_option = "--labels names";
    read.without_labels = "write --labels none";
    read.materials = options_.labels == LabelSource::kMaterial ? &materials_ : nullptr;
    read.warnings = warnings_;
    read.file_in_warnings = std::filesystem::path(source_.files[tile]).filename().string();
    TESSERA_ASSIGN_OR_RETURN(MeshContent content, ReadMesh(source_.files[tile], read));
    TriangleMesh& mesh = content.mesh;
    merged_.tile_rects.push_back(PlanRectOf(mesh));
    TESSERA_RETURN_IF_ERROR(ToScene(source_.files[tile], &mesh));
    const std::vector<uint32_t> numbers = AddVertices(mesh);
    int64_t added = 0;
    CountedLabel counted;
    for (size_t f = 0; f < mesh.faces.size(); ++f) {
      const Triangle& face = mesh.faces[f];
      const SpooledFace merged = {{numbers[face[0]], numbers[face[1]], numbers[face[2]]},
                                  mesh.labels.empty() ? -1 : mesh.labels[f]};
      if (!IsDegenerate(face) && IsDegenerate(merged.vertices)) {
        ++merged_.collapsed_faces;
        continue;
      }
      if (counted.faces == nullptr || counted.label != merged.label) {
        counted = {merged.label, &faces_of_label_[merged.label]};  // faces of one label follow each other
      }
      ++*counted.faces;
      faces_->Add(merged);
      ++added;
    }
    merged_.tile_faces.push_back(added);
    merged_.faces += added;
    if (options_.labels == LabelSource::kProperty && faces_of_label_.size() > kMaxLabelValues) {
      return InputError(source_.files[tile], "",
                        absl::StrCat("more than ", kMaxLabelValues, " values of ", Quoted(options_.label_property)),
                        "a property with a class index, not with the number of an object");
    }
    if (merged_.vertices >= RimWelder::kNone) {
      return InputError(source_.files[tile], "", "more than 4,294,967,294 vertices in all tiles", "fewer tiles");
    }
    TESSERA_RETURN_IF_ERROR(vertices_->status());
    return faces_->status();
  }

  struct CountedLabel {
    int32_t label = -1;
    int64_t* faces = nullptr;
  };

  static PlanRect PlanRectOf(const TriangleMesh& mesh) {
    Eigen::AlignedBox3d box;
    for (const Eigen::Vector3d& position : mesh.vertices) box.extend(position);
    return box.isEmpty() ? PlanRect() : PlanRect{box.min().x(), box.min().y(), box.max().x(), box.max().y()};
  }

  static bool IsDegenerate(const Triangle& face) {
    return face[0] == face[1] || face[1] == face[2] || face[2] == face[0];
  }

  Status ToScene(const std::string& file, TriangleMesh* mesh) {
    for (size_t v = 0; v < mesh->vertices.size(); ++v) {
      Eigen::Vector3d& position = mesh->vertices[v];
      position += source_.offset;
      if (options_.scene_from_source) position = options_.scene_from_source(position);
      if (position.allFinite() && position.cwiseAbs().maxCoeff() <= RimWelder::kMaxCoordinate) continue;
      return InputError(file, absl::StrCat("vertex ", v), "a position that has no coordinates in the scene's system",
                        "a mesh in the system and with the offset of its metadata (see --crs)");
    }
    return absl::OkStatus();
  }

  // Adds the vertices that are not welded to earlier ones. Returns their numbers in the merged mesh.
  std::vector<uint32_t> AddVertices(const TriangleMesh& mesh) {
    std::vector<bool> is_rim(mesh.vertices.size());
    if (source_.files.size() > 1) is_rim = RimVertices(mesh);
    std::vector<uint32_t> numbers(mesh.vertices.size());
    for (size_t v = 0; v < numbers.size(); ++v) {
      const Eigen::Vector3d& position = mesh.vertices[v];
      numbers[v] = is_rim[v] ? welder_.Find(position) : RimWelder::kNone;
      if (numbers[v] != RimWelder::kNone) {
        ++merged_.welded_vertices;
        is_rim[v] = false;
        continue;
      }
      numbers[v] = static_cast<uint32_t>(merged_.vertices++);
      merged_.bounds.extend(position);
      vertices_->Add(position);
    }
    for (size_t v = 0; v < numbers.size(); ++v) {
      if (is_rim[v]) welder_.Add(mesh.vertices[v], numbers[v]);
    }
    return numbers;
  }

  // Fills class_of_label_ and the merged mesh's classes and labels.
  Status ChooseClasses() {
    if (options_.labels == LabelSource::kNone) return absl::OkStatus();
    merged_.classes = options_.classes;
    for (const auto& [name, class_name] : options_.class_map) {
      if (!class_name.empty() && IndexOfClass(class_name) < 0) merged_.classes.push_back(class_name);
    }
    for (const auto& [label, faces] : faces_of_label_) {
      if (label < 0) {
        merged_.faces_without_class += faces;
        continue;
      }
      merged_.labels.push_back({NameOf(label), faces, -1});
      int32_t& chosen = merged_.labels.back().label;
      const auto mapped = options_.class_map.find(merged_.labels.back().name);
      if (mapped != options_.class_map.end()) {
        chosen = mapped->second.empty() ? -1 : IndexOfClass(mapped->second);
      } else if (options_.labels == LabelSource::kProperty && options_.class_map.empty()) {
        chosen = label;
      } else {
        chosen = options_.labels == LabelSource::kMaterial ? IndexOfClass(merged_.labels.back().name) : -1;
        if (chosen < 0) unknown_.push_back(merged_.labels.back());
      }
      if (chosen < 0) merged_.faces_without_class += faces;
      class_of_label_[label] = chosen;
    }
    return unknown_.empty() ? absl::OkStatus() : UnknownNames();
  }

  std::string NameOf(int32_t label) const {
    if (options_.labels == LabelSource::kProperty) return absl::StrCat(label);
    return materials_.names()[static_cast<size_t>(label)];
  }

  int32_t IndexOfClass(const std::string& name) const {
    const auto found = std::find(merged_.classes.begin(), merged_.classes.end(), name);
    return found == merged_.classes.end() ? -1 : static_cast<int32_t>(found - merged_.classes.begin());
  }

  Status UnknownNames() const {
    std::string entries;
    for (size_t k = 0; k < std::min(unknown_.size(), kMaxListedMaterials); ++k) {
      absl::StrAppend(&entries, k == 0 ? "" : ", ", JsonQuoted(unknown_[k].name), ": \"CLASS\"");
    }
    if (unknown_.size() > kMaxListedMaterials) absl::StrAppend(&entries, ", ...");
    std::string classes;
    for (const std::string& name : merged_.classes) absl::StrAppend(&classes, classes.empty() ? "" : ", ", name);
    const char* const what = options_.labels == LabelSource::kMaterial ? "materials" : "labels";
    return InputError("mesh", what, absl::StrCat(unknown_.size(), " names without a class"),
                      absl::StrCat("each of them in the file of --classes, with a class or null: {", entries,
                                   "}; classes of the scene: ", Printable(classes)));
  }

  Status Write(const std::string& out_ply) {
    options_.control.Report(kTileReadingShare, "writing the mesh");
    PlyLayout layout;
    layout.vertices = merged_.vertices;
    layout.faces = merged_.faces;
    layout.has_labels = options_.labels != LabelSource::kNone;
    TESSERA_ASSIGN_OR_RETURN(PlyStream stream, PlyStream::Create(out_ply, layout));
    TESSERA_RETURN_IF_ERROR(
        vertices_->Read(options_.control, [&](const Eigen::Vector3d& position) { stream.AddVertex(position); }));
    struct {
      int32_t label = -1, chosen = -1;
    } last;
    TESSERA_RETURN_IF_ERROR(faces_->Read(options_.control, [&](const SpooledFace& spooled) {
      PlyFace face;
      face.vertices = spooled.vertices;
      if (layout.has_labels && spooled.label != last.label) {
        last = {spooled.label, spooled.label < 0 ? -1 : class_of_label_.at(spooled.label)};
      }
      face.label = last.chosen;
      stream.AddFace(face);
    }));
    TESSERA_RETURN_IF_ERROR(stream.Finish());
    options_.control.Report(1, "mesh written");
    return absl::OkStatus();
  }

  const MeshSource& source_;
  const MergeOptions& options_;
  Warnings* const warnings_;
  RimWelder welder_;
  MaterialNames materials_;
  Spool<Eigen::Vector3d>* vertices_ = nullptr;
  Spool<SpooledFace>* faces_ = nullptr;
  std::map<int32_t, int64_t> faces_of_label_;
  std::map<int32_t, int32_t> class_of_label_;
  std::vector<LabelUse> unknown_;
  MergedMesh merged_;
};

}  // namespace

StatusOr<MergedMesh> MergeMeshes(const MeshSource& source, const MergeOptions& options, const std::string& out_ply,
                                 Warnings* warnings) {
  return TileMerger(source, options, warnings).Merge(out_ply);
}

}  // namespace tessera
