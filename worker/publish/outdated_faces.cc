#include "worker/publish/outdated_faces.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

constexpr char kIds[] = "face_ids";

}  // namespace

Status WriteOutdatedFaces(const std::string& path, const std::vector<uint32_t>& ids) {
  ArrayFile file;
  file.arrays = {{kIds, ids}};
  return WriteArrayFile(path, file);
}

StatusOr<OutdatedFaces> OutdatedFaces::Open(const std::string& path) {
  OutdatedFaces faces;
  TESSERA_ASSIGN_OR_RETURN(faces.file_, MappedArrays::Open(path));
  TESSERA_ASSIGN_OR_RETURN(faces.ids_, faces.file_.Verified<uint32_t>(kIds));
  const auto fault = std::adjacent_find(faces.ids_.begin(), faces.ids_.end(), std::greater_equal<>());
  if (fault == faces.ids_.end()) return faces;
  return absl::DataLossError(
      absl::StrCat(path, ": found face ", fault[1], " after ", fault[0], ", expected ascending ids"));
}

OutdatedFaceFinder::OutdatedFaceFinder(const GroundPlane& ground, const ChangeRaster& measured,
                                       std::span<const uint32_t> base, std::vector<ChangeArea>* areas)
    : ground_(ground), measured_(measured), base_(base), areas_(*areas), unfollowed_(measured.cells(), *areas) {}

bool OutdatedFaceFinder::Asks(const CellRect& block) const { return !base_.empty() || unfollowed_.AnyIn(block); }

bool OutdatedFaceFinder::Known(const Eigen::Vector2i& cell) const {
  const CellRect& cells = measured_.cells();
  const size_t i = static_cast<size_t>(cell.y() - cells.y0) * measured_.after.width() + (cell.x() - cells.x0);
  return !std::isnan(measured_.after.height_m[i]);
}

void OutdatedFaceFinder::Add(const CollectedFaces& faces, const CellRect& block) {
  for (size_t f = 0; f < faces.face_ids.size(); ++f) {
    const Eigen::Vector2i cell = ground_.Cell(MeshSpans(faces.mesh).Centroid(f));
    if (!block.Contains(cell)) continue;
    const uint32_t id = faces.face_ids[f];
    if (const int area = unfollowed_.AreaOf(cell); area >= 0) {
      ++areas_[area].outdated_faces;
      found_.push_back(id);
    } else if (Known(cell) && std::binary_search(base_.begin(), base_.end(), id)) {
      right_.push_back(id);
    }
  }
}

std::vector<uint32_t> OutdatedFaceFinder::Finish() && {
  std::sort(found_.begin(), found_.end());
  std::sort(right_.begin(), right_.end());
  std::vector<uint32_t> left, all;
  std::set_difference(base_.begin(), base_.end(), right_.begin(), right_.end(), std::back_inserter(left));
  std::set_union(left.begin(), left.end(), found_.begin(), found_.end(), std::back_inserter(all));
  return all;
}

}  // namespace tessera
