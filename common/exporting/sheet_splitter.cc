#include "common/exporting/sheet_splitter.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <span>
#include <tuple>

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

constexpr int64_t kFaceGrain = 1 << 16;
constexpr double kMaxCell = 1 << 30;  // cells fit an int

struct SplitMesh {
  const SplitOptions& options;
  ScratchArray<Eigen::Vector3d> positions;
  ScratchArray<float> displacements_m;
  ScratchArray<Triangle> faces;
  ScratchArray<int32_t> labels;
  ScratchArray<float> confidence;
};

// The sheet of each face as an index into `sheets`, which are those with faces by y, then x.
struct FaceSheets {
  std::vector<SheetId> sheets;
  std::vector<size_t> begin;     // of each sheet's faces in `order`; one more at the end
  ScratchArray<uint32_t> order;  // faces by sheet, ascending in each
};

// Numbers the sheets in the order of their first face, and resolves those that may not exist.
class SheetNumbers {
 public:
  explicit SheetNumbers(const std::vector<SheetId>& allowed) : allowed_(allowed) {
    std::sort(allowed_.begin(), allowed_.end());
  }
  uint32_t Of(const SheetId& id) {
    if (!sheets_.empty() && id == last_) return last_number_;
    last_ = id;
    const auto known = numbers_.find(id);
    if (known != numbers_.end()) return last_number_ = known->second;
    const SheetId sheet = allowed_.empty() ? id : allowed_[NearestSheet(id, allowed_)];
    const auto [at, is_new] = numbers_.try_emplace(sheet, static_cast<uint32_t>(sheets_.size()));
    if (is_new) sheets_.push_back(sheet);
    last_number_ = at->second;
    numbers_[id] = last_number_;
    return last_number_;
  }
  const std::vector<SheetId>& sheets() const { return sheets_; }

 private:
  std::vector<SheetId> allowed_, sheets_;
  std::map<SheetId, uint32_t> numbers_;  // also of sheets that may not exist
  SheetId last_;
  uint32_t last_number_ = 0;
};

// The sheet of a face's centroid.
StatusOr<SheetId> SheetOfFace(const SplitMesh& mesh, size_t face) {
  const Triangle& corners = mesh.faces[face];
  for (const uint32_t vertex : corners) {
    if (vertex < mesh.positions.size()) continue;
    return absl::InvalidArgumentError(absl::StrCat("face ", face, ": found vertex index ", vertex,
                                                   ", expected an index below ", mesh.positions.size()));
  }
  const Eigen::Vector3d centroid =
      (mesh.positions[corners[0]] + mesh.positions[corners[1]] + mesh.positions[corners[2]]) / 3;
  const Eigen::Vector2d cell = mesh.options.ground.Coordinates(centroid) / mesh.options.ground.cell_m;
  if (!(cell.cwiseAbs().maxCoeff() < kMaxCell)) {
    return absl::InvalidArgumentError(
        absl::StrCat("face ", face, ": found a position ", centroid.norm() / 1000,
                     " km from the frame's origin, expected a mesh in the scene's coordinates"));
  }
  return SheetOf(mesh.options.ground.Cell(centroid));
}

StatusOr<FaceSheets> GroupFaces(const SplitMesh& mesh, const std::string& scratch_folder, const TaskControl& control) {
  const size_t count = mesh.faces.size();
  if (count > std::numeric_limits<uint32_t>::max()) {
    return absl::InvalidArgumentError(absl::StrCat("found ", count, " faces, expected at most 4294967295"));
  }
  TESSERA_ASSIGN_OR_RETURN(auto number_of, ScratchArray<uint32_t>::Create(scratch_folder, count));
  SheetNumbers numbers(mesh.options.allowed);
  std::vector<size_t> faces_of;
  for (size_t begin = 0; begin < count; begin += kFaceGrain) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(static_cast<double>(begin) / static_cast<double>(count), "sorting faces into sheets");
    const size_t end = std::min<size_t>(count, begin + kFaceGrain);
    for (size_t f = begin; f < end; ++f) {
      TESSERA_ASSIGN_OR_RETURN(const SheetId id, SheetOfFace(mesh, f));
      number_of[f] = numbers.Of(id);
      faces_of.resize(numbers.sheets().size());
      ++faces_of[number_of[f]];
    }
  }
  FaceSheets grouped;
  grouped.sheets = numbers.sheets();
  std::sort(grouped.sheets.begin(), grouped.sheets.end());
  std::vector<size_t> next(grouped.sheets.size());  // by number, the place of the next face
  grouped.begin.push_back(0);
  for (const SheetId& sheet : grouped.sheets) {
    const uint32_t number = numbers.Of(sheet);
    next[number] = grouped.begin.back();
    grouped.begin.push_back(next[number] + faces_of[number]);
  }
  TESSERA_ASSIGN_OR_RETURN(grouped.order, ScratchArray<uint32_t>::Create(scratch_folder, count));
  for (size_t f = 0; f < count; ++f) grouped.order[next[number_of[f]]++] = static_cast<uint32_t>(f);
  return grouped;
}

constexpr uint32_t kSeveralSheets = std::numeric_limits<uint32_t>::max();

// Per vertex: the number of its only sheet from 1 on, or kSeveralSheets; 0 if it has no face.
StatusOr<ScratchArray<uint32_t>> SheetsOfVertices(const SplitMesh& mesh, const FaceSheets& grouped,
                                                  const std::string& scratch_folder) {
  TESSERA_ASSIGN_OR_RETURN(auto sheets, ScratchArray<uint32_t>::Create(scratch_folder, mesh.positions.size()));
  for (uint32_t s = 0; s < grouped.sheets.size(); ++s) {
    for (size_t i = grouped.begin[s]; i < grouped.begin[s + 1]; ++i) {
      for (const uint32_t v : mesh.faces[grouped.order[i]]) {
        sheets[v] = sheets[v] == 0 || sheets[v] == s + 1 ? s + 1 : kSeveralSheets;
      }
    }
  }
  return sheets;
}

// The sheet of these faces.
Sheet GatherSheet(const SplitMesh& mesh, const ScratchArray<uint32_t>& sheets, std::span<const uint32_t> faces) {
  std::vector<uint32_t> vertices;
  vertices.reserve(3 * faces.size());
  for (const uint32_t face : faces) {
    const Triangle& corners = mesh.faces[face];
    vertices.insert(vertices.end(), corners.begin(), corners.end());
  }
  std::sort(vertices.begin(), vertices.end());
  vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
  Sheet sheet;
  sheet.vertices.reserve(vertices.size());
  sheet.shared.reserve(vertices.size());
  for (const uint32_t vertex : vertices) {
    sheet.vertices.push_back(mesh.positions[vertex]);
    sheet.shared.push_back(sheets[vertex] == kSeveralSheets ? 1 : 0);
  }
  if (mesh.options.has_displacement) {
    sheet.displacement_m.reserve(vertices.size());
    for (const uint32_t vertex : vertices) sheet.displacement_m.push_back(mesh.displacements_m[vertex]);
  }
  sheet.faces.reserve(faces.size());
  sheet.labels.reserve(faces.size());
  for (const uint32_t face : faces) {
    Triangle& corners = sheet.faces.emplace_back(mesh.faces[face]);
    for (uint32_t& corner : corners) {
      corner = static_cast<uint32_t>(std::lower_bound(vertices.begin(), vertices.end(), corner) - vertices.begin());
    }
    sheet.labels.push_back(mesh.labels[face]);
    if (mesh.options.has_confidence) sheet.confidence.push_back(mesh.confidence[face]);
  }
  return sheet;
}

}  // namespace

size_t NearestSheet(const SheetId& id, const std::vector<SheetId>& sheets) {
  size_t nearest = 0;
  double nearest_distance = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < sheets.size(); ++i) {
    if (sheets[i] == id) return i;
    const double dx = std::max(std::abs(static_cast<double>(sheets[i].x) - id.x) - 1, 0.0);
    const double dy = std::max(std::abs(static_cast<double>(sheets[i].y) - id.y) - 1, 0.0);
    const double distance = dx * dx + dy * dy;
    if (distance > nearest_distance) continue;
    if (distance == nearest_distance && sheets[i] > sheets[nearest]) continue;
    nearest = i;
    nearest_distance = distance;
  }
  return nearest;
}

std::string SheetPath(const std::string& folder, const SheetId& id) {
  return absl::StrCat(folder, "/", SheetName(id), ".arrays");
}

StatusOr<SheetSplitter> SheetSplitter::Create(const std::string& scratch_folder, SplitOptions options) {
  TESSERA_ASSIGN_OR_RETURN(auto positions, ScratchList<Eigen::Vector3d>::Create(scratch_folder));
  TESSERA_ASSIGN_OR_RETURN(auto displacements_m, ScratchList<float>::Create(scratch_folder));
  TESSERA_ASSIGN_OR_RETURN(auto faces, ScratchList<Triangle>::Create(scratch_folder));
  TESSERA_ASSIGN_OR_RETURN(auto labels, ScratchList<int32_t>::Create(scratch_folder));
  TESSERA_ASSIGN_OR_RETURN(auto confidence, ScratchList<float>::Create(scratch_folder));
  return SheetSplitter(scratch_folder, std::move(options), std::move(positions), std::move(displacements_m),
                       std::move(faces), std::move(labels), std::move(confidence));
}

void SheetSplitter::AddVertex(const Eigen::Vector3d& position, float displacement_m) {
  positions_.Append(position);
  if (options_.has_displacement) displacements_m_.Append(displacement_m);
}

void SheetSplitter::AddFace(const Triangle& face, int32_t label, float confidence) {
  faces_.Append(face);
  labels_.Append(label);
  if (options_.has_confidence) confidence_.Append(confidence);
}

StatusOr<std::vector<SheetEntry>> SheetSplitter::Finish(const std::string& folder, const TaskControl& control) {
  SplitMesh mesh{options_, {}, {}, {}, {}, {}};
  TESSERA_ASSIGN_OR_RETURN(mesh.positions, positions_.Finish());
  TESSERA_ASSIGN_OR_RETURN(mesh.displacements_m, displacements_m_.Finish());
  TESSERA_ASSIGN_OR_RETURN(mesh.faces, faces_.Finish());
  TESSERA_ASSIGN_OR_RETURN(mesh.labels, labels_.Finish());
  TESSERA_ASSIGN_OR_RETURN(mesh.confidence, confidence_.Finish());
  constexpr double kGroupShare = 0.2;
  TESSERA_ASSIGN_OR_RETURN(const FaceSheets grouped,
                           GroupFaces(mesh, scratch_folder_, PartOf(control, 0, kGroupShare)));
  TESSERA_ASSIGN_OR_RETURN(const ScratchArray<uint32_t> sheets, SheetsOfVertices(mesh, grouped, scratch_folder_));
  std::vector<SheetEntry> entries;
  for (size_t s = 0; s < grouped.sheets.size(); ++s) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(
        kGroupShare + (1 - kGroupShare) * static_cast<double>(s) / static_cast<double>(grouped.sheets.size()),
        absl::StrCat("writing sheet ", s + 1, " of ", grouped.sheets.size()));
    const size_t begin = grouped.begin[s], end = grouped.begin[s + 1];
    const Sheet sheet = GatherSheet(mesh, sheets, grouped.order.values().subspan(begin, end - begin));
    SheetEntry& entry = entries.emplace_back();
    entry.id = grouped.sheets[s];
    entry.faces = static_cast<int64_t>(sheet.faces.size());
    entry.vertices = static_cast<int64_t>(sheet.vertices.size());
    for (const Eigen::Vector3d& p : sheet.vertices) entry.box.extend(p);
    TESSERA_RETURN_IF_ERROR(WriteSheet(SheetPath(folder, entry.id), sheet));
  }
  return entries;
}

}  // namespace tessera
