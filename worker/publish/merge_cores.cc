#include "worker/publish/merge_cores.h"

#include <cstring>

#include "absl/strings/str_cat.h"
#include "worker/city/id_merge.h"

namespace tessera {
namespace {

bool SameBytes(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::memcmp(a.data(), b.data(), 3 * sizeof(double)) == 0;
}

Status CoreError(int tile, const char* what, uint32_t id, const std::string& fault) {
  return absl::DataLossError(absl::StrCat("core of tile ", tile, ": ", what, " ", id, " ", fault));
}

Status CountError(const char* what, int64_t found, int64_t expected) {
  return absl::DataLossError(absl::StrCat("city: its blocks have ", found, " ", what, ", expected ", expected));
}

Status CheckAscending(int tile, const char* what, std::span<const uint32_t> ids) {
  for (size_t i = 1; i < ids.size(); ++i) {
    if (ids[i] <= ids[i - 1])
      return CoreError(tile, what, ids[i], absl::StrCat("follows ", ids[i - 1], ", expected ascending ids"));
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<CoreMerger> CoreMerger::Create(const CityReader& city, std::vector<CoreSpans> cores) {
  CoreMerger merger;
  merger.city_ = &city;
  merger.cores_ = std::move(cores);
  for (const CoreSpans& core : merger.cores_) {
    TESSERA_RETURN_IF_ERROR(CheckAscending(core.tile, "vertex", core.vertex_ids));
    TESSERA_RETURN_IF_ERROR(CheckAscending(core.tile, "face", core.face_ids));
  }
  for (size_t b = 0; b < city.block_count(); ++b) {
    TESSERA_ASSIGN_OR_RETURN(CityBlock block, city.Block(b));
    merger.blocks_.push_back(block);
  }
  return merger;
}

Status CoreMerger::ForEachVertex(const std::function<void(const MergedVertex&)>& visit) const {
  std::vector<std::span<const uint32_t>> city_lists, core_lists;
  for (const CityBlock& block : blocks_) city_lists.push_back(block.vertex_ids);
  for (const CoreSpans& core : cores_) core_lists.push_back(core.vertex_ids);
  IdMerge<uint32_t> in_city(std::move(city_lists)), in_cores(std::move(core_lists));
  MergedVertex vertex;
  int64_t visited = 0;
  for (; !in_city.AtEnd(); ++visited) {
    vertex.id = in_city.key();
    vertex.before = blocks_[in_city.list()].mesh.vertices[in_city.index()];
    while (!in_city.AtEnd() && in_city.key() == vertex.id) in_city.Advance();
    if (in_cores.AtEnd() || in_cores.key() != vertex.id) {
      return absl::DataLossError(
          absl::StrCat("vertex ", vertex.id, ": found in no tile's core, expected in at least one"));
    }
    const CoreSpans& first = cores_[in_cores.list()];
    vertex.after = first.positions[in_cores.index()];
    for (in_cores.Advance(); !in_cores.AtEnd() && in_cores.key() == vertex.id; in_cores.Advance()) {
      const CoreSpans& other = cores_[in_cores.list()];
      if (!SameBytes(vertex.after, other.positions[in_cores.index()])) {
        return CoreError(other.tile, "vertex", vertex.id,
                         absl::StrCat("has another position than in the core of tile ", first.tile));
      }
    }
    visit(vertex);
  }
  if (visited != city_->vertices()) return CountError("vertices", visited, city_->vertices());
  if (!in_cores.AtEnd()) return CoreError(cores_[in_cores.list()].tile, "vertex", in_cores.key(), "is not in the city");
  return absl::OkStatus();
}

Status CoreMerger::ForEachFace(const std::function<void(const MergedFace&)>& visit) const {
  std::vector<std::span<const uint32_t>> city_lists, core_lists;
  for (const CityBlock& block : blocks_) city_lists.push_back(block.face_ids);
  for (const CoreSpans& core : cores_) core_lists.push_back(core.face_ids);
  IdMerge<uint32_t> in_city(std::move(city_lists)), in_cores(std::move(core_lists));
  std::vector<std::span<const FlippedFace>> flipped_left;
  for (const CoreSpans& core : cores_) flipped_left.push_back(core.flipped);
  MergedFace face;
  int64_t visited = 0;
  for (; !in_city.AtEnd(); ++visited, in_city.Advance()) {
    if (visited > 0 && in_city.key() == face.id) {
      return absl::DataLossError(absl::StrCat("city: found face ", face.id, " in two blocks, expected in one"));
    }
    face.id = in_city.key();
    const CityBlock& block = blocks_[in_city.list()];
    const size_t at = in_city.index();
    face.vertices = block.GlobalFace(at);
    face.area_before_m2 = FaceArea(block.mesh, at);
    face.label_before = block.mesh.labels[at];
    face.input_face = block.input_face[at];
    if (in_cores.AtEnd() || in_cores.key() != face.id) {
      return absl::DataLossError(absl::StrCat("face ", face.id, ": found in no tile's core, expected in one"));
    }
    const CoreSpans& core = cores_[in_cores.list()];
    face.label = core.labels[in_cores.index()];
    face.confidence = core.confidence[in_cores.index()];
    std::span<const FlippedFace>& flipped = flipped_left[in_cores.list()];
    if (!flipped.empty() && flipped.front().face == in_cores.index()) {
      for (int k = 0; k < 3; ++k) face.vertices[k] = core.vertex_ids[flipped.front().vertices[k]];
      flipped = flipped.subspan(1);
    }
    in_cores.Advance();
    if (!in_cores.AtEnd() && in_cores.key() == face.id) {
      return CoreError(cores_[in_cores.list()].tile, "face", face.id,
                       absl::StrCat("is also in the core of tile ", core.tile));
    }
    visit(face);
  }
  if (visited != city_->faces()) return CountError("faces", visited, city_->faces());
  if (!in_cores.AtEnd()) return CoreError(cores_[in_cores.list()].tile, "face", in_cores.key(), "is not in the city");
  return absl::OkStatus();
}

}  // namespace tessera
