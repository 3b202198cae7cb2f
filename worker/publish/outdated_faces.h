// Faces of an update's result that lie as things were before: where it could not follow what the new images show.
#ifndef TESSERA_WORKER_PUBLISH_OUTDATED_FACES_H_
#define TESSERA_WORKER_PUBLISH_OUTDATED_FACES_H_

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

// kOutdatedFile: global ids of faces, ascending.
Status WriteOutdatedFaces(const std::string& path, const std::vector<uint32_t>& ids);

// Such a file in the address space.
class OutdatedFaces {
 public:
  // None.
  OutdatedFaces() = default;
  // Reads it once and checks it: DATA_LOSS if it is damaged or its ids do not ascend.
  static StatusOr<OutdatedFaces> Open(const std::string& path);
  std::span<const uint32_t> ids() const { return ids_; }

 private:
  MappedArrays file_;
  std::span<const uint32_t> ids_;
};

// Finds them block by block. They lie in the areas that the refined mesh does not follow; a face counts where its
// middle lies in plan. Those of the base stay where the new images tell nothing. Memory: 4 bytes a cell that was
// measured and 4 a face found.
class OutdatedFaceFinder {
 public:
  // `measured`: all blocks; `base`: ids of the base, ascending. All must outlive it. Counts faces into `areas`.
  OutdatedFaceFinder(const GroundPlane& ground, const ChangeRaster& measured, std::span<const uint32_t> base,
                     std::vector<ChangeArea>* areas);

  // Whether Add must be called for the block.
  bool Asks(const CellRect& block) const;
  // `faces`: of the refined mesh, all that lie in the block at least; those that lie in other blocks do not count.
  void Add(const CollectedFaces& faces, const CellRect& block);
  std::vector<uint32_t> Finish() &&;

 private:
  bool Known(const Eigen::Vector2i& cell) const;

  const GroundPlane& ground_;
  const ChangeRaster& measured_;
  std::span<const uint32_t> base_;
  std::vector<ChangeArea>& areas_;
  UnfollowedCells unfollowed_;
  std::vector<uint32_t> found_, right_;  // `right_`: of the base's
};

}  // namespace tessera

#endif  // TESSERA_WORKER_PUBLISH_OUTDATED_FACES_H_
