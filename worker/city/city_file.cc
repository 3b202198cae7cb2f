#include "worker/city/city_file.h"

#include <algorithm>
#include <array>
#include <limits>
#include <map>
#include <numeric>
#include <unordered_map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/storage/hash.h"
#include "common/storage/mapped_file.h"

namespace tessera {
namespace {

static_assert(sizeof(Eigen::Vector3d) == 3 * sizeof(double) && sizeof(Triangle) == 3 * sizeof(uint32_t));

// Arrays of the file. Names with "block" have one row per block; the others are the concatenated values of all
// blocks.
constexpr char kVertexIds[] = "vertex_ids", kPositions[] = "positions", kFaces[] = "faces", kFaceIds[] = "face_ids",
               kLabels[] = "labels", kInputFace[] = "input_face", kBlockCells[] = "block_cells",
               kBlockBoxes[] = "block_boxes", kBlockEnds[] = "block_ends", kBlockSums[] = "block_checksums",
               kCounts[] = "counts";

uint64_t CellKey(int x, int y) {
  return static_cast<uint64_t>(static_cast<uint32_t>(y)) << 32 | static_cast<uint32_t>(x);
}

template <class T>
void Add(std::span<const T> values, Xxh3Hasher* hasher) {
  hasher->Update(values.data(), values.size_bytes());
}

uint64_t Checksum(const CityBlock& block) {
  Xxh3Hasher hasher;
  Add(block.vertex_ids, &hasher);
  Add(block.mesh.vertices, &hasher);
  Add(block.mesh.faces, &hasher);
  Add(block.face_ids, &hasher);
  Add(block.mesh.labels, &hasher);
  Add(block.input_face, &hasher);
  return hasher.Digest();
}

// Bisects cells [begin, end) of `cells` recursively into blocks and sorts them accordingly.
void Halve(std::vector<SurveyCell>* cells, size_t begin, size_t end, int64_t max_faces, std::vector<CellRect>* blocks) {
  CellRect rect = {INT32_MAX, INT32_MAX, INT32_MIN, INT32_MIN};
  int64_t faces = 0;
  for (size_t i = begin; i < end; ++i) {
    const SurveyCell& cell = (*cells)[i];
    rect = {std::min(rect.x0, cell.x), std::min(rect.y0, cell.y), std::max(rect.x1, cell.x + 1),
            std::max(rect.y1, cell.y + 1)};
    faces += cell.faces;
  }
  if (faces <= max_faces || end - begin <= 1) {
    blocks->push_back(rect);
    return;
  }
  // Split the longer side, which gives the most compact halves.
  const bool by_x = static_cast<int64_t>(rect.x1) - rect.x0 >= static_cast<int64_t>(rect.y1) - rect.y0;
  std::map<int, int64_t> faces_at;
  for (size_t i = begin; i < end; ++i) faces_at[by_x ? (*cells)[i].x : (*cells)[i].y] += (*cells)[i].faces;
  int border = 0;
  int64_t before = 0, best = std::numeric_limits<int64_t>::max();
  for (auto it = faces_at.begin(); std::next(it) != faces_at.end(); ++it) {
    before += it->second;
    const int64_t difference = std::abs(2 * before - faces);
    if (difference < best) {
      best = difference;
      border = it->first + 1;
    }
  }
  const auto middle = std::stable_partition(cells->begin() + static_cast<std::ptrdiff_t>(begin),
                                            cells->begin() + static_cast<std::ptrdiff_t>(end),
                                            [&](const SurveyCell& cell) { return (by_x ? cell.x : cell.y) < border; });
  const auto half = static_cast<size_t>(middle - cells->begin());
  Halve(cells, begin, half, max_faces, blocks);
  Halve(cells, half, end, max_faces, blocks);
}

// Index of the block that contains each cell.
std::unordered_map<uint64_t, uint32_t> BlockOfCell(const std::vector<SurveyCell>& cells,
                                                   const std::vector<CellRect>& blocks) {
  std::map<std::pair<int, int>, uint64_t> unplaced;  // by (y, x)
  for (const SurveyCell& cell : cells) unplaced[{cell.y, cell.x}] = CellKey(cell.x, cell.y);
  std::unordered_map<uint64_t, uint32_t> block_of;
  block_of.reserve(cells.size());
  for (uint32_t b = 0; b < blocks.size(); ++b) {
    const CellRect& rect = blocks[b];
    for (int y = rect.y0; y < rect.y1; ++y) {
      for (auto it = unplaced.lower_bound({y, rect.x0}); it != unplaced.end(); ++it) {
        if (it->first.first != y || it->first.second >= rect.x1) break;
        block_of[it->second] = b;
      }
    }
  }
  return block_of;
}

// Extracts lists of faces as meshes of their own.
class BlockBuilder {
 public:
  // Sets the block's vertices and its faces in local indices.
  void Build(const MeshSpans& mesh, std::span<const uint32_t> face_ids) {
    vertex_ids.clear();
    faces.clear();
    for (const uint32_t f : face_ids) {
      vertex_ids.insert(vertex_ids.end(), mesh.faces[f].begin(), mesh.faces[f].end());
    }
    std::sort(vertex_ids.begin(), vertex_ids.end());
    vertex_ids.erase(std::unique(vertex_ids.begin(), vertex_ids.end()), vertex_ids.end());
    for (const uint32_t f : face_ids) {
      Triangle& face = faces.emplace_back();
      for (int k = 0; k < 3; ++k) {
        face[k] = static_cast<uint32_t>(std::lower_bound(vertex_ids.begin(), vertex_ids.end(), mesh.faces[f][k]) -
                                        vertex_ids.begin());
      }
    }
  }
  std::vector<uint32_t> vertex_ids;
  std::vector<Triangle> faces;
};

}  // namespace

std::vector<CellRect> LayOutBlocks(const std::vector<SurveyCell>& cells, int64_t max_faces) {
  std::vector<CellRect> blocks;
  if (cells.empty()) return blocks;
  std::vector<SurveyCell> in_order;
  in_order.reserve(cells.size());
  for (const SurveyCell& cell : cells) {
    SurveyCell& copy = in_order.emplace_back();
    copy.x = cell.x;
    copy.y = cell.y;
    copy.faces = cell.faces;
  }
  Halve(&in_order, 0, in_order.size(), max_faces, &blocks);
  return blocks;
}

std::vector<SurveyCell> CellsOf(const MeshSpans& mesh, const GroundPlane& ground) {
  std::unordered_map<uint64_t, SurveyCell> by_key;
  SurveyCell* last = nullptr;  // consecutive faces are mostly in the same cell
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const Eigen::Vector2i at = ground.Cell(mesh.Centroid(f));
    if (last == nullptr || last->x != at.x() || last->y != at.y()) {
      const auto [it, is_new] = by_key.try_emplace(CellKey(at.x(), at.y()));
      last = &it->second;
      if (is_new) {
        last->x = at.x();
        last->y = at.y();
        last->box_min = last->box_max = mesh.Corner(f, 0);
      }
    }
    ++last->faces;
    const CellRect square = {at.x(), at.y(), at.x() + 1, at.y() + 1};
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d& p = mesh.Corner(f, k);
      last->box_min = last->box_min.cwiseMin(p);
      last->box_max = last->box_max.cwiseMax(p);
      last->reach_m = std::max(last->reach_m, DistanceToRect(ground.Coordinates(p), square, ground.cell_m));
    }
  }
  std::vector<SurveyCell> cells;
  cells.reserve(by_key.size());
  for (auto& [key, cell] : by_key) cells.push_back(std::move(cell));
  std::sort(cells.begin(), cells.end(),
            [](const SurveyCell& a, const SurveyCell& b) { return a.y != b.y ? a.y < b.y : a.x < b.x; });
  return cells;
}

Status WriteCity(const std::string& path, const CitySpans& city, const GroundPlane& ground,
                 const std::vector<SurveyCell>& cells, const std::string& scratch_folder, int64_t max_block_faces) {
  const MeshSpans& mesh = city.mesh;
  const std::vector<CellRect> rects = LayOutBlocks(cells, max_block_faces);
  const std::unordered_map<uint64_t, uint32_t> block_of = BlockOfCell(cells, rects);
  // Sort faces by block, then by id.
  std::vector<int64_t> face_ends(rects.size() + 1, 0);
  TESSERA_ASSIGN_OR_RETURN(auto block_of_face, ScratchArray<uint32_t>::Create(scratch_folder, mesh.faces.size()));
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const Eigen::Vector2i at = ground.Cell(mesh.Centroid(f));
    const auto it = block_of.find(CellKey(at.x(), at.y()));
    if (it == block_of.end())
      return absl::InternalError(absl::StrCat("face ", f, ": its cell is not in the list of cells"));
    block_of_face[f] = it->second;
    ++face_ends[it->second + 1];
  }
  std::partial_sum(face_ends.begin(), face_ends.end(), face_ends.begin());
  TESSERA_ASSIGN_OR_RETURN(auto order, ScratchArray<uint32_t>::Create(scratch_folder, mesh.faces.size()));
  std::vector<int64_t> next(face_ends.begin(), face_ends.end() - 1);
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    order[static_cast<size_t>(next[block_of_face[f]]++)] = static_cast<uint32_t>(f);
  }
  block_of_face = {};
  const auto faces_of = [&](size_t block) {
    return std::span<const uint32_t>(order.values())
        .subspan(static_cast<size_t>(face_ends[block]), static_cast<size_t>(face_ends[block + 1] - face_ends[block]));
  };

  // Collect the vertices of each block; their number is only known afterwards.
  std::vector<int64_t> vertex_ends = {0};
  TESSERA_ASSIGN_OR_RETURN(auto vertex_list, ScratchList<uint32_t>::Create(scratch_folder));
  TESSERA_ASSIGN_OR_RETURN(auto corner_list, ScratchList<Triangle>::Create(scratch_folder));
  BlockBuilder builder;
  for (size_t b = 0; b < rects.size(); ++b) {
    builder.Build(mesh, faces_of(b));
    vertex_list.Append(std::span<const uint32_t>(builder.vertex_ids));
    corner_list.Append(std::span<const Triangle>(builder.faces));
    vertex_ends.push_back(static_cast<int64_t>(vertex_list.size()));
  }
  TESSERA_ASSIGN_OR_RETURN(const auto vertex_ids, vertex_list.Finish());
  TESSERA_ASSIGN_OR_RETURN(const auto corners, corner_list.Finish());

  const uint64_t faces = mesh.faces.size(), vertices = vertex_ids.size(), blocks = rects.size();
  TESSERA_ASSIGN_OR_RETURN(auto writer, ArrayFileWriter::Create(path, "{}",
                                                                {{kCounts, std::vector<int64_t>(), 4},
                                                                 {kBlockCells, std::vector<int32_t>(), 4 * blocks},
                                                                 {kBlockBoxes, std::vector<double>(), 6 * blocks},
                                                                 {kBlockEnds, std::vector<int64_t>(), 2 * blocks},
                                                                 {kBlockSums, std::vector<int64_t>(), blocks},
                                                                 {kVertexIds, std::vector<uint32_t>(), vertices},
                                                                 {kPositions, std::vector<double>(), 3 * vertices},
                                                                 {kFaces, std::vector<uint32_t>(), 3 * faces},
                                                                 {kFaceIds, std::vector<uint32_t>(), faces},
                                                                 {kLabels, std::vector<int32_t>(), faces},
                                                                 {kInputFace, std::vector<uint32_t>(), faces}}));
  const auto id_of = [](std::span<const uint32_t> ids, uint32_t index) { return ids.empty() ? index : ids[index]; };
  const auto vertex_count = static_cast<int64_t>(mesh.vertices.size()), face_count = static_cast<int64_t>(faces);
  writer->Append<int64_t>(kCounts, std::array{vertex_count, face_count, std::max(vertex_count, city.vertex_ids_end),
                                              std::max(face_count, city.face_ids_end)});
  for (size_t b = 0; b < rects.size(); ++b) {
    const auto vertex_begin = static_cast<size_t>(vertex_ends[b]);
    CityBlock block;
    block.mesh.faces = corners.values().subspan(static_cast<size_t>(face_ends[b]), faces_of(b).size());
    std::vector<Eigen::Vector3d> positions;
    std::vector<uint32_t> ids_of_vertices, ids_of_faces;
    Eigen::AlignedBox3d box;
    for (const uint32_t v :
         vertex_ids.values().subspan(vertex_begin, static_cast<size_t>(vertex_ends[b + 1]) - vertex_begin)) {
      ids_of_vertices.push_back(id_of(city.vertex_ids, v));
      positions.push_back(mesh.vertices[v]);
      box.extend(positions.back());
    }
    block.vertex_ids = ids_of_vertices;
    block.mesh.vertices = positions;
    std::vector<int32_t> labels;
    std::vector<uint32_t> input_face;
    for (const uint32_t f : faces_of(b)) {
      ids_of_faces.push_back(id_of(city.face_ids, f));
      labels.push_back(mesh.labels[f]);
      input_face.push_back(id_of(city.input_face, f));
    }
    block.face_ids = ids_of_faces;
    block.mesh.labels = labels;
    block.input_face = input_face;
    writer->Append<int32_t>(kBlockCells, std::array{rects[b].x0, rects[b].y0, rects[b].x1, rects[b].y1});
    writer->Append<double>(kBlockBoxes, std::array{box.min().x(), box.min().y(), box.min().z(), box.max().x(),
                                                   box.max().y(), box.max().z()});
    writer->Append<int64_t>(kBlockEnds, std::array{vertex_ends[b + 1], face_ends[b + 1]});
    writer->Append<int64_t>(kBlockSums, std::array{static_cast<int64_t>(Checksum(block))});
    writer->Append<uint32_t>(kVertexIds, block.vertex_ids);
    writer->Append<double>(kPositions, std::span(positions.data()->data(), 3 * positions.size()));
    writer->Append<uint32_t>(kFaces, std::span(block.mesh.faces.data()->data(), 3 * block.mesh.faces.size()));
    writer->Append<uint32_t>(kFaceIds, block.face_ids);
    writer->Append<int32_t>(kLabels, labels);
    writer->Append<uint32_t>(kInputFace, input_face);
  }
  return writer->Finish();
}

StatusOr<CityReader> CityReader::Open(const std::string& path) {
  CityReader city;
  TESSERA_ASSIGN_OR_RETURN(city.file_, MappedArrays::Open(path));
  const MappedArrays& file = city.file_;
  TESSERA_ASSIGN_OR_RETURN(const auto counts, file.Verified<int64_t>(kCounts, 4));
  TESSERA_ASSIGN_OR_RETURN(const auto sums, file.Verified<int64_t>(kBlockSums));
  const auto blocks = static_cast<int64_t>(sums.size());
  TESSERA_ASSIGN_OR_RETURN(const auto cells, file.Verified<int32_t>(kBlockCells, 4 * blocks));
  TESSERA_ASSIGN_OR_RETURN(const auto boxes, file.Verified<double>(kBlockBoxes, 6 * blocks));
  TESSERA_ASSIGN_OR_RETURN(const auto ends, file.Verified<int64_t>(kBlockEnds, 2 * blocks));
  TESSERA_ASSIGN_OR_RETURN(city.vertex_ids_, file.Get<uint32_t>(kVertexIds));
  const auto vertices = static_cast<int64_t>(city.vertex_ids_.size());
  city.vertices_ = counts[0];
  city.faces_ = counts[1];
  city.vertex_ids_end_ = counts[2];
  city.face_ids_end_ = counts[3];
  TESSERA_ASSIGN_OR_RETURN(city.positions_, file.Get<double>(kPositions, 3 * vertices));
  TESSERA_ASSIGN_OR_RETURN(city.corners_, file.Get<uint32_t>(kFaces, 3 * city.faces_));
  TESSERA_ASSIGN_OR_RETURN(city.face_ids_, file.Get<uint32_t>(kFaceIds, city.faces_));
  TESSERA_ASSIGN_OR_RETURN(city.labels_, file.Get<int32_t>(kLabels, city.faces_));
  TESSERA_ASSIGN_OR_RETURN(city.input_face_, file.Get<uint32_t>(kInputFace, city.faces_));
  Entry last;
  for (int64_t b = 0; b < blocks; ++b) {
    const int32_t* c = cells.data() + 4 * b;
    const double* p = boxes.data() + 6 * b;
    Entry entry;
    entry.cells = {c[0], c[1], c[2], c[3]};
    entry.box = {Eigen::Vector3d(p[0], p[1], p[2]), Eigen::Vector3d(p[3], p[4], p[5])};
    entry.vertex_begin = last.vertex_end;
    entry.face_begin = last.face_end;
    entry.vertex_end = ends[2 * b];
    entry.face_end = ends[2 * b + 1];
    entry.checksum = static_cast<uint64_t>(sums[b]);
    if (entry.vertex_end < entry.vertex_begin || entry.vertex_end > vertices || entry.face_end < entry.face_begin ||
        entry.face_end > city.faces_) {
      return absl::DataLossError(
          absl::StrCat(path, ": block ", b, ": its ranges overlap the previous block or exceed the file's arrays"));
    }
    city.blocks_.push_back(entry);
    last = entry;
  }
  if (last.vertex_end != vertices || last.face_end != city.faces_) {
    return absl::DataLossError(
        absl::StrCat(path, ": found blocks with ", last.face_end, " faces, expected ", city.faces_));
  }
  return city;
}

StatusOr<CityBlock> CityReader::Block(size_t index) const {
  const Entry& entry = blocks_[index];
  const auto vertex_begin = static_cast<size_t>(entry.vertex_begin), face_begin = static_cast<size_t>(entry.face_begin);
  const size_t vertex_count = static_cast<size_t>(entry.vertex_end) - vertex_begin;
  const size_t face_count = static_cast<size_t>(entry.face_end) - face_begin;
  CityBlock block;
  block.cells = entry.cells;
  block.box = entry.box;
  block.vertex_ids = vertex_ids_.subspan(vertex_begin, vertex_count);
  block.mesh.vertices = {reinterpret_cast<const Eigen::Vector3d*>(positions_.data()) + vertex_begin, vertex_count};
  block.mesh.faces = {reinterpret_cast<const Triangle*>(corners_.data()) + face_begin, face_count};
  block.face_ids = face_ids_.subspan(face_begin, face_count);
  block.mesh.labels = labels_.subspan(face_begin, face_count);
  block.input_face = input_face_.subspan(face_begin, face_count);
  const auto damaged = [&](const std::string& what) {
    return absl::DataLossError(absl::StrCat(file_.path(), ": block ", index, ": ", what));
  };
  if (Checksum(block) != entry.checksum) return damaged("checksum mismatch; the file is damaged");
  for (const Triangle& face : block.mesh.faces) {
    for (const uint32_t v : face) {
      if (v >= vertex_count)
        return damaged(absl::StrCat("found vertex index ", v, ", expected less than ", vertex_count));
    }
  }
  if (vertex_count > 0 && block.vertex_ids.back() >= vertex_ids_end_)
    return damaged("found a vertex id beyond the city's last id");
  if (face_count > 0 && block.face_ids.back() >= face_ids_end_)
    return damaged("found a face id beyond the city's last id");
  return block;
}

}  // namespace tessera
