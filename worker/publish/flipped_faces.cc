#include "worker/publish/flipped_faces.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "worker/refine/edge_flips.h"

namespace tessera {

StatusOr<CollectedFaces> FacesOfCore(const CityReader& city, const GroundPlane& ground, const CellRect& rect,
                                     const CoreSpans& core) {
  TESSERA_ASSIGN_OR_RETURN(CollectedFaces faces, CollectCells(city, ground, rect));
  if (!std::equal(faces.face_ids.begin(), faces.face_ids.end(), core.face_ids.begin(), core.face_ids.end()) ||
      !std::equal(faces.vertex_ids.begin(), faces.vertex_ids.end(), core.vertex_ids.begin(), core.vertex_ids.end())) {
    return absl::DataLossError(absl::StrCat("core of tile ", core.tile,
                                            ": found faces or vertices other than those of the city in its rectangle; "
                                            "the tile's state belongs to another city"));
  }
  return faces;
}

StatusOr<ScratchArray<FlippedFace>> FlipCores(const CityReader& city, const GroundPlane& ground,
                                              const std::vector<TileParameters>& tiles,
                                              const std::vector<int>& quarantined, const std::string& folder,
                                              const TaskControl& control, std::vector<CoreSpans>* cores) {
  TESSERA_ASSIGN_OR_RETURN(auto list, ScratchList<FlippedFace>::Create(folder));
  std::vector<size_t> ends;
  for (size_t t = 0; t < tiles.size(); ++t) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(static_cast<double>(t) / static_cast<double>(tiles.size()), "flipping edges");
    const CoreSpans& core = (*cores)[t];
    if (!std::binary_search(quarantined.begin(), quarantined.end(), tiles[t].tile)) {
      TESSERA_ASSIGN_OR_RETURN(CollectedFaces faces, FacesOfCore(city, ground, tiles[t].core, core));
      std::vector<uint64_t> groups(faces.mesh.faces.size());
      for (size_t f = 0; f < groups.size(); ++f) {
        const Eigen::Vector2i cell = ground.Cell(MeshSpans(faces.mesh).Centroid(f));
        groups[f] = static_cast<uint64_t>(static_cast<uint32_t>(cell.x())) << 32 | static_cast<uint32_t>(cell.y());
      }
      faces.mesh.vertices.assign(core.positions.begin(), core.positions.end());
      faces.mesh.labels.assign(core.labels.begin(), core.labels.end());
      for (const uint32_t f : FlipEdges(groups, &faces.mesh)) list.Append({f, faces.mesh.faces[f]});
    }
    ends.push_back(list.size());
  }
  TESSERA_ASSIGN_OR_RETURN(ScratchArray<FlippedFace> flipped, list.Finish());
  for (size_t t = 0; t < tiles.size(); ++t) {
    const size_t begin = t == 0 ? 0 : ends[t - 1];
    (*cores)[t].flipped = std::span(flipped.values()).subspan(begin, ends[t] - begin);
  }
  return flipped;
}

}  // namespace tessera
