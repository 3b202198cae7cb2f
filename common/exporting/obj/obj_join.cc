#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <numeric>
#include <set>
#include <span>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/exporting/obj/obj_format.h"
#include "common/exporting/obj/obj_layout.h"
#include "common/exporting/obj/obj_materials.h"
#include "common/exporting/obj/obj_part.h"
#include "common/geometry/position_index.h"
#include "common/storage/files.h"
#include "common/storage/new_file.h"
#include "common/storage/temporary_name.h"

namespace tessera {
namespace {

constexpr int kObjDecimals = 9;
constexpr char kWholeObj[] = "mesh";
constexpr double kMaxObjCoordinate = 1e15;  // longer texts would not fit

// A file to write: pieces of parts, in the order of the sheets.
struct ObjFilePlan {
  struct Source {
    size_t sheet;
    int32_t tile;
  };
  std::string path;  // relative to the export's folder, without ending
  std::vector<Source> pieces;
};

StatusOr<std::vector<ObjFilePlan>> PlanObjFiles(int64_t max_faces, const JoinInput& input) {
  TESSERA_ASSIGN_OR_RETURN(const std::vector<std::string> tiles, ObjTilePaths(input.scene));
  std::vector<ObjFilePlan> by_tile(std::max<size_t>(tiles.size(), 1)), by_sheet;
  for (size_t t = 0; t < by_tile.size(); ++t) by_tile[t].path = tiles.empty() ? kWholeObj : tiles[t];
  int64_t faces = 0;
  for (size_t s = 0; s < input.sheets.size(); ++s) {
    const JoinInput::Item& sheet = input.sheets[s];
    TESSERA_ASSIGN_OR_RETURN(const MappedArrays part, MappedArrays::Open(sheet.part_path));
    TESSERA_ASSIGN_OR_RETURN(const std::vector<ObjPieceCount> pieces, ReadObjPieceCounts(part));
    for (const ObjPieceCount& piece : pieces) {
      if (piece.tile < 0 || static_cast<size_t>(piece.tile) >= by_tile.size()) {
        return absl::DataLossError(absl::StrCat(sheet.part_path, ": found tile ", piece.tile, ", expected fewer than ",
                                                by_tile.size(), " tiles"));
      }
      by_tile[static_cast<size_t>(piece.tile)].pieces.push_back({s, piece.tile});
      faces += piece.faces;
    }
    if (pieces.empty()) continue;
    by_sheet.push_back({ObjTilePath(absl::StrFormat("Tile_%+04d_%+04d", sheet.id.x, sheet.id.y)), {{s, 0}}});
  }
  std::vector<ObjFilePlan>& plans = tiles.empty() && faces > max_faces ? by_sheet : by_tile;
  std::erase_if(plans, [](const ObjFilePlan& plan) { return plan.pieces.empty(); });
  return std::move(plans);
}

class ObjWriter {
 public:
  // `materials`: as ObjMaterialNames; empty: none.
  ObjWriter(const std::string& path, std::span<const std::string> materials)
      : path_(path), temporary_(TemporaryBeside(path)), file_(temporary_), materials_(materials) {
    if (!materials.empty()) file_.Add(absl::StrCat("mtllib ", kObjMaterialFile, "\n"));
  }

  void AddComment(const std::string& text) { file_.Add(absl::StrCat("# ", text, "\n")); }

  Status Add(const ObjPiece& piece) {
    const std::vector<int64_t> numbers = AddVertices(piece);
    if (numbers.empty() && !piece.vertices.empty()) {
      return absl::InvalidArgumentError(absl::StrCat(path_, ": found a coordinate above ", kMaxObjCoordinate,
                                                     ", expected coordinates of the chosen crs"));
    }
    if (materials_.empty()) {
      for (size_t f = 0; f < piece.faces.size() / 3; ++f) AddFace(piece, f, numbers);
      return absl::OkStatus();
    }
    std::vector<uint32_t> order(piece.faces.size() / 3);
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(),
                     [&](uint32_t a, uint32_t b) { return MaterialOf(piece, a) < MaterialOf(piece, b); });
    for (const uint32_t f : order) {
      const size_t material = MaterialOf(piece, f);
      if (material != material_) file_.Add(absl::StrCat("usemtl ", materials_[material], "\n"));
      material_ = material;
      AddFace(piece, f, numbers);
    }
    return absl::OkStatus();
  }

  Status Finish() {
    TESSERA_RETURN_IF_ERROR(file_.Finish());
    return RenameDurably(temporary_, path_);
  }

 private:
  size_t MaterialOf(const ObjPiece& piece, size_t face) const {
    const int64_t label = piece.labels.empty() ? -1 : piece.labels[face];
    const size_t unclassified = materials_.size() - 1;
    return label < 0 ? unclassified : std::min(static_cast<size_t>(label), unclassified);
  }

  // Writes the vertices that no earlier piece has. Returns the numbers of all in the file, from 1 on; none if a
  // coordinate is too large.
  std::vector<int64_t> AddVertices(const ObjPiece& piece) {
    const size_t known = number_of_rim_.size();  // vertices of one piece stay apart
    std::vector<int64_t> numbers(piece.is_rim.size());
    for (size_t v = 0; v < numbers.size(); ++v) {
      const double* const p = &piece.vertices[3 * v];
      if (!std::all_of(p, p + 3, [](double x) { return std::abs(x) < kMaxObjCoordinate; })) return {};
      if (piece.is_rim[v] != 0) {
        const uint32_t rim = rims_.NumberOf({p[0], p[1], p[2]});
        if (rim < known) {
          numbers[v] = number_of_rim_[rim];
          continue;
        }
        if (rim == number_of_rim_.size()) number_of_rim_.push_back(vertices_ + 1);
      }
      numbers[v] = ++vertices_;
      char text[128] = "v";
      char* at = text + 1;
      for (int k = 0; k < 3; ++k) {
        *at++ = ' ';
        at = std::to_chars(at, text + sizeof(text), p[k], std::chars_format::fixed, kObjDecimals).ptr;
      }
      *at++ = '\n';
      file_.Add(text, static_cast<size_t>(at - text));
    }
    return numbers;
  }

  void AddFace(const ObjPiece& piece, size_t face, const std::vector<int64_t>& numbers) {
    char text[80] = "f";
    char* at = text + 1;
    for (size_t k = 0; k < 3; ++k) {
      *at++ = ' ';
      at = std::to_chars(at, text + sizeof(text), numbers[piece.faces[3 * face + k]]).ptr;
    }
    *at++ = '\n';
    file_.Add(text, static_cast<size_t>(at - text));
  }

  const std::string path_, temporary_;
  NewFile file_;
  const std::span<const std::string> materials_;
  size_t material_ = static_cast<size_t>(-1);  // the last one written
  int64_t vertices_ = 0;
  PositionIndex rims_;
  std::vector<int64_t> number_of_rim_;  // by rims_: number of the vertex in the file
};

Status WriteObjFile(const JoinInput& input, const ObjFilePlan& plan, const std::string& path,
                    std::span<const std::string> materials, const TaskControl& control) {
  ObjWriter writer(path, materials);
  const bool set_aside = std::any_of(plan.pieces.begin(), plan.pieces.end(), [&](const ObjFilePlan::Source& source) {
    return input.sheets[source.sheet].set_aside;
  });
  if (set_aside) writer.AddComment("quarantined: some faces may be of tiles whose refinement failed");
  for (const ObjFilePlan::Source& source : plan.pieces) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    TESSERA_ASSIGN_OR_RETURN(const MappedArrays part, MappedArrays::Open(input.sheets[source.sheet].part_path));
    TESSERA_ASSIGN_OR_RETURN(const ObjPiece piece, ReadObjPiece(part, source.tile));
    TESSERA_RETURN_IF_ERROR(writer.Add(piece));
  }
  return writer.Finish();
}

}  // namespace

StatusOr<std::vector<std::string>> JoinObj(const JoinInput& input, const std::string& folder,
                                           const TaskControl& control) {
  return JoinObjUpTo(kMaxFacesOfObj, input, folder, control);
}

StatusOr<std::vector<std::string>> JoinObjUpTo(int64_t max_faces, const JoinInput& input, const std::string& folder,
                                               const TaskControl& control) {
  TESSERA_ASSIGN_OR_RETURN(const ExportMap map, OpenObjMap(input.scene, input.options));
  TESSERA_ASSIGN_OR_RETURN(const Eigen::Vector3d offset, ObjOffset(input.scene, map));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<ObjFilePlan> plans, PlanObjFiles(max_faces, input));
  std::vector<std::string> materials, names;
  if (input.options.class_materials) materials = ObjMaterialNames(input.scene.classes);
  std::set<std::string> folders;
  const auto write = [&](const std::string& name, const std::string& content) {
    names.push_back(name);
    return WriteFileAtomic(absl::StrCat(folder, "/", name), content);
  };
  for (size_t k = 0; k < plans.size(); ++k) {
    const std::string name = plans[k].path + ".obj";
    control.Report(static_cast<double>(k) / static_cast<double>(plans.size()), name);
    TESSERA_ASSIGN_OR_RETURN(const std::string path, JoinInside(folder, name));
    const std::string of_file = std::filesystem::path(name).parent_path().string();
    TESSERA_RETURN_IF_ERROR(EnsureFolder(absl::StrCat(folder, "/", of_file)));
    TESSERA_RETURN_IF_ERROR(WriteObjFile(input, plans[k], path, materials, control));
    names.push_back(name);
    if (materials.empty() || !folders.insert(of_file).second) continue;
    TESSERA_RETURN_IF_ERROR(
        write(absl::StrCat(of_file, of_file.empty() ? "" : "/", kObjMaterialFile), ObjMaterials(input.scene.classes)));
  }
  const std::string metadata = ObjMetadata(map, offset);
  if (!metadata.empty()) TESSERA_RETURN_IF_ERROR(write("metadata.xml", metadata));
  if (!materials.empty()) TESSERA_RETURN_IF_ERROR(write("classes.json", ObjClassMap(input.scene.classes)));
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace tessera
