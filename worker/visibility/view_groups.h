// View selection per group of faces, and masks on face maps.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "worker/visibility/rasterizer.h"

namespace tessera {

// Which views are selected for which faces. The selection is made per ground cell, so that every tile that contains a
// face uses the same views for it.
struct ViewGroups {
  std::vector<uint32_t> group_of_face;         // empty: every view is selected for every face
  std::vector<std::vector<uint8_t>> selected;  // per group: one flag per view, 1 if selected

  // Flag per group whether the view is selected; empty if it is for all.
  std::vector<uint8_t> SelectedIn(size_t view) const;
};

// `selected`: of SelectedIn. Refers to both.
inline FaceSelection SelectionOf(const ViewGroups& groups, const std::vector<uint8_t>& selected) {
  return selected.empty() ? FaceSelection() : FaceSelection{groups.group_of_face.data(), selected.data()};
}

// Flags of faces as bits, which stay in the cache.
class FaceBits {
 public:
  explicit FaceBits(const std::vector<uint8_t>& flags);
  bool operator[](int32_t face) const { return (words_[face >> 6] >> (face & 63) & 1) != 0; }
  enum class Share { kNone, kSome, kAll };
  // How many of the faces [first, last] have a flag.
  Share Of(int32_t first, int32_t last) const;

 private:
  std::vector<uint64_t> words_;
  std::vector<uint32_t> before_;  // number of flags in the words before each
};

// Sets FaceMap::face to -1 at every pixel that lies more than `margin_px` rows or columns from all pixels of faces
// with a flag in `own`. Depths stay.
void KeepNearOwn(const FaceBits& own, int margin_px, FaceMap* map);

}  // namespace tessera
