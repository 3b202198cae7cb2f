// Outdated faces: faces of an update's result that still show the old state because refinement could not follow the
// new images.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/arrays/mapped_arrays.h"
#include "common/base/status.h"
#include "common/job/ground.h"
#include "worker/changes/change_areas.h"
#include "worker/changes/change_raster.h"
#include "worker/changes/unfollowed_cells.h"
#include "worker/city/collected_faces.h"

namespace tessera {

// Writes kOutdatedFile: global face ids, ascending.
Status WriteOutdatedFaces(const std::string& path, const std::vector<uint32_t>& ids);

// A memory-mapped kOutdatedFile.
class OutdatedFaces {
 public:
  // The empty set.
  OutdatedFaces() = default;
  // Reads and verifies the whole file: DATA_LOSS if it is damaged or its ids do not ascend.
  static StatusOr<OutdatedFaces> Open(const std::string& path);
  std::span<const uint32_t> ids() const { return ids_; }

 private:
  MappedArrays file_;
  std::span<const uint32_t> ids_;
};

// Finds outdated faces block by block: faces whose centroid lies, in plan, in an area that the refined mesh does not
// follow. Outdated faces of the base job remain outdated where the new images measure nothing. Memory: 4 bytes per
// measured cell and 4 per face found.
class OutdatedFaceFinder {
 public:
  // `measured`: raster of all blocks; `base`: outdated ids of the base job, ascending. All must outlive the object.
  // Adds the counts to `areas`.
  OutdatedFaceFinder(const GroundPlane& ground, const ChangeRaster& measured, std::span<const uint32_t> base,
                     std::vector<ChangeArea>* areas);

  // Whether Add must be called for this block.
  bool Asks(const CellRect& block) const;
  // `faces`: at least all faces of the refined mesh in the block; faces of other blocks are ignored.
  void Add(const CollectedFaces& faces, const CellRect& block);
  std::vector<uint32_t> Finish() &&;

 private:
  bool Known(const Eigen::Vector2i& cell) const;

  const GroundPlane& ground_;
  const ChangeRaster& measured_;
  std::span<const uint32_t> base_;
  std::vector<ChangeArea>& areas_;
  UnfollowedCells unfollowed_;
  std::vector<uint32_t> found_, right_;  // `right_`: faces of the base that are correct now
};

}  // namespace tessera
