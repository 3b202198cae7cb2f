// Agreement of the orientations of adjacent faces, and of the faces with the views.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/geometry/mesh_defects.h"
#include "common/geometry/viewpoint.h"

namespace tessera {

// Faces that are connected by edges with two faces are a piece. First join all such edges, then call Decide once. The
// result depends on the order of the calls only in pieces that cannot be oriented (Möbius strips).
class FaceOrientation {
 public:
  // `links`: one number per face of scratch memory, which must outlive this object.
  explicit FaceOrientation(std::span<uint32_t> links);

  // The face is degenerate or dropped: it is not turned. It must not be joined.
  void Exclude(uint32_t face) { links_[face] = kExcluded; }
  // The faces share an edge, which both have in the same direction (they disagree), or in opposite directions.
  void Join(uint32_t face, uint32_t other, bool same_direction);

  // Decides for each piece which side is outside. The faces of a piece are turned to agree. The side that the views see
  // is outside, if the views that see it from there are three, and twice as many as those that see the other side; else
  // the side that is outside for most of the faces. So pieces that agree keep their orientation if no view sees them.
  // Sees: the middle of a sampled face is in the image and not occluded.
  // Returns the number of turned faces and the first, and the number of pieces of at most 100 faces that
  // fewer than two views see or that have an area below 25 px in each (their first faces), without views none.
  // `scratch_folder`: for meshes of more than `max_faces_for_rays`, whose occlusion is tested with a coarse mesh.
  struct Result {
    DefectCount turned_faces, small_pieces;
  };
  StatusOr<Result> Decide(const MeshSpans& mesh, std::span<const Viewpoint> views, const std::string& scratch_folder,
                          size_t max_faces_for_rays);

  // After Decide, whether the face's orientation must be reversed.
  bool IsTurned(uint32_t face) const;

 private:
  static constexpr uint32_t kExcluded = UINT32_MAX;
  struct Root {
    uint32_t face;
    uint32_t parity;  // 1: the face's orientation differs from the root's
  };
  Root Find(uint32_t face) const;

  std::span<uint32_t> links_;  // 2 parent + parity; of a root after Decide, the parity says whether it is turned
};

}  // namespace tessera
