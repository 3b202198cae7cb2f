#include "common/exporting/obj/obj_part.h"

#include <algorithm>
#include <map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/importing/rim_welder.h"

namespace tessera {
namespace {

constexpr uint32_t kNoObjVertex = 0xffffffff;

std::string ObjPieceArray(const char* what, int32_t tile) { return absl::StrCat(what, ".", tile); }

}  // namespace

Status WriteObjPart(const std::string& path, const CutMesh& mesh, std::span<const int32_t> labels) {
  std::map<int32_t, std::vector<uint32_t>> faces_of_tile;
  for (size_t f = 0; f < mesh.faces.size(); ++f) faces_of_tile[mesh.tiles[f]].push_back(static_cast<uint32_t>(f));
  ArrayFile file;
  std::vector<int32_t> tiles;
  std::vector<int64_t> counts;
  std::vector<uint32_t> numbers(mesh.vertices.size(), kNoObjVertex);
  for (const auto& [tile, faces] : faces_of_tile) {
    TriangleMesh piece;
    std::vector<uint32_t> used;
    for (const uint32_t f : faces) {
      for (const uint32_t v : mesh.faces[f]) {
        if (numbers[v] != kNoObjVertex) continue;
        numbers[v] = 0;
        used.push_back(v);
      }
    }
    std::sort(used.begin(), used.end());  // keeps the order of the sheet
    for (const uint32_t v : used) {
      numbers[v] = static_cast<uint32_t>(piece.vertices.size());
      piece.vertices.push_back(mesh.vertices[v]);
    }
    for (const uint32_t f : faces) {
      const Triangle& face = mesh.faces[f];
      piece.faces.push_back({numbers[face[0]], numbers[face[1]], numbers[face[2]]});
      if (!labels.empty()) piece.labels.push_back(labels[mesh.source_faces[f]]);
    }
    for (const uint32_t v : used) numbers[v] = kNoObjVertex;
    const std::vector<bool> is_rim = RimVertices(piece);
    std::vector<double> positions;
    positions.reserve(3 * piece.vertices.size());
    for (const Eigen::Vector3d& p : piece.vertices) positions.insert(positions.end(), {p.x(), p.y(), p.z()});
    std::vector<uint32_t> corners;
    corners.reserve(3 * piece.faces.size());
    for (const Triangle& face : piece.faces) corners.insert(corners.end(), face.begin(), face.end());
    file.arrays[ObjPieceArray("vertices", tile)] = std::move(positions);
    file.arrays[ObjPieceArray("faces", tile)] = std::move(corners);
    file.arrays[ObjPieceArray("labels", tile)] = std::move(piece.labels);
    file.arrays[ObjPieceArray("is_rim", tile)] = std::vector<uint8_t>(is_rim.begin(), is_rim.end());
    tiles.push_back(tile);
    counts.push_back(static_cast<int64_t>(faces.size()));
  }
  file.arrays["tiles"] = std::move(tiles);
  file.arrays["face_counts"] = std::move(counts);
  return WriteArrayFile(path, file);
}

StatusOr<std::vector<ObjPieceCount>> ReadObjPieceCounts(const MappedArrays& part) {
  TESSERA_ASSIGN_OR_RETURN(const std::span<const int32_t> tiles, part.Verified<int32_t>("tiles"));
  TESSERA_ASSIGN_OR_RETURN(const std::span<const int64_t> counts,
                           part.Verified<int64_t>("face_counts", static_cast<int64_t>(tiles.size())));
  std::vector<ObjPieceCount> pieces;
  for (size_t k = 0; k < tiles.size(); ++k) pieces.push_back({tiles[k], counts[k]});
  return pieces;
}

StatusOr<ObjPiece> ReadObjPiece(const MappedArrays& part, int32_t tile) {
  ObjPiece piece;
  TESSERA_ASSIGN_OR_RETURN(piece.vertices, part.Verified<double>(ObjPieceArray("vertices", tile)));
  TESSERA_ASSIGN_OR_RETURN(piece.faces, part.Verified<uint32_t>(ObjPieceArray("faces", tile)));
  TESSERA_ASSIGN_OR_RETURN(piece.labels, part.Verified<int32_t>(ObjPieceArray("labels", tile)));
  TESSERA_ASSIGN_OR_RETURN(piece.is_rim, part.Verified<uint8_t>(ObjPieceArray("is_rim", tile)));
  const size_t vertices = piece.vertices.size() / 3, faces = piece.faces.size() / 3;
  const auto largest = std::max_element(piece.faces.begin(), piece.faces.end());
  if (piece.vertices.size() % 3 != 0 || piece.faces.size() % 3 != 0 || piece.is_rim.size() != vertices ||
      (!piece.labels.empty() && piece.labels.size() != faces) ||
      (largest != piece.faces.end() && *largest >= vertices)) {
    return absl::DataLossError(absl::StrCat(part.path(), ": the arrays of tile ", tile, " do not fit each other"));
  }
  return piece;
}

}  // namespace tessera
