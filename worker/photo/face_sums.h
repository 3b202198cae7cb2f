// Reduces pixel derivatives to faces: sums over the pixels of a view that see a face, weighted by barycentric
// coordinates.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"
#include "worker/photo/reference_strip.h"
#include "worker/visibility/mesh_cells.h"
#include "worker/visibility/raster_kernel.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {

// Per corner: derivative and curvature along the normal. Per face: pairs.
struct FaceSums {
  std::array<float, 3> gradient = {0, 0, 0};
  std::array<float, 3> curvature = {0, 0, 0};
  float pairs = 0;  // mean number of pairs per pixel of the face, summed over views
};

// Sums over the pixels of a face in one strip. Sums over pixels suffice because a barycentric coordinate divided by z is
// affine in the image.
struct alignas(16) FaceMoments {
  using Lanes = float __attribute__((vector_size(16)));

  Lanes sums = {};        // of g z, h z, the pairs, 1
  Lanes moments = {};     // of g z x, h z x, g z y, h z y; x and y are relative to the face's first pixel
  Lanes first_pixel = {};  // x, x, y, y
  int32_t face = -1;
  int32_t x = 0, y = 0;  // the face's first pixel, in the map
};

// Buffers of FaceGatherer::AddStrip, one per thread, reused between calls. They hold the faces that a strip shows: with
// many threads, an entry per face of the mesh would take more memory than the mesh.
struct FaceSlots {
  static constexpr int kPageBits = 8;
  static constexpr uint32_t kNoPage = 0xffffffff;

  // Starts a strip of a mesh with this number of faces.
  void Begin(size_t faces);
  // The entry of a face in `slots`; -1: any. May move `slots`.
  uint32_t SlotOf(int32_t face) {
    const auto slot = static_cast<uint32_t>(std::max(face, 0));
    uint32_t page = pages[slot >> kPageBits];
    if (page == kNoPage) [[unlikely]]
      page = AddPage(slot >> kPageBits);
    return page + (slot & ((uint32_t{1} << kPageBits) - 1));
  }
  // Gives faces page·2^kPageBits and so on a place in `slots`.
  uint32_t AddPage(size_t page);

  uint32_t strip = 0;           // counts the calls
  std::vector<uint32_t> pages;  // per 2^kPageBits faces: where they begin in `slots`, or kNoPage
  std::vector<uint32_t> seen;   // the entries of `pages` that are not kNoPage
  // Index of the face in `found` and, in the upper half, the strip that wrote it, so that pages need not be cleared.
  std::vector<uint64_t> slots;
  std::vector<FaceMoments> found;
  // Of the pixels of a row that see a face to sum: the column, and the index of the face in `found`.
  std::vector<int32_t> columns, indices;
  std::vector<int32_t> first_columns;  // of the faces found in a row
};

// When strips add to the sums of their faces.
enum class StripSums {
  kAtOnce,  // in AddStrip
  kWait,    // in Finish: other views come first
};

// Reduces one view, strip by strip. Strips may be added in any order and from any thread with the same result. Views
// may be reduced at the same time if all but the first wait and they finish in their order: the sums of a face are then
// added in the order of the views.
class FaceGatherer {
 public:
  // Starts a view. `map`: drawn from `camera`. `part`: contains the faces to sum of the map. `own`: flags of the faces
  // to sum; empty: all. `sums`: one entry per face; strips add to it. The references must stay valid until Finish.
  void Begin(const TriangleMesh& mesh, const MeshPart& part, const PosedCamera& camera, const FaceMap& map,
             const std::vector<uint8_t>& own, int strips, StripSums when, std::vector<FaceSums>* sums);
  // Marks a strip as empty.
  void SkipStrip(int strip);
  // Adds the planes of a finished strip. Thread-safe for different strips and slots.
  void AddStrip(int strip, const ReferenceStrip& planes, FaceSlots* slots);
  // After the last strip, before Finish: prepares the faces that reach over the border of a strip. Thread-safe for
  // different views.
  void JoinStrips();
  // Adds what waits, and the faces that reach over the border of a strip. Runs on all threads.
  void Finish();

  // Memory that a view takes, about.
  static double Bytes(const TriangleMesh& mesh) {
    return static_cast<double>(sizeof(ImageVertex)) * static_cast<double>(mesh.vertices.size());
  }

 private:
  // Of one strip's pixels of a face.
  struct Part {
    int32_t face = -1;
    FaceSums sums;  // `pairs` before division by the pixels
    float pixels = 0;
  };
  template <bool kAll>
  void AddRow(const ReferenceStrip& planes, int y, FaceSlots* buffers) const;
  Part ToCorners(const FaceMoments& moments) const;
  // ToCorners of a face that the rasteriser's grid does not hold.
  void UnboundedToCorners(const FaceMoments& moments, FaceSums* out) const;
  void PrefetchSums(int32_t face) const {
    __builtin_prefetch(&(*sums_)[face], 1);
    __builtin_prefetch(&(*sums_)[face].pairs, 1);
  }
  // Whether all pixel centres in the image of a face are in these rows.
  bool IsWithin(int32_t face, int row_begin, int row_end) const;

  const TriangleMesh* mesh_ = nullptr;
  const PosedCamera* camera_ = nullptr;
  const FaceMap* map_ = nullptr;
  const std::vector<uint8_t>* own_ = nullptr;
  StripSums when_ = StripSums::kAtOnce;
  std::vector<FaceSums>* sums_ = nullptr;
  std::vector<ImageVertex> corners_;        // images of the vertices
  std::vector<std::vector<Part>> waiting_;  // per strip: faces that have no pixels in other strips
  std::vector<std::vector<Part>> shared_;   // per strip: faces that may have pixels in other strips
  std::vector<Part> joined_;                // of all strips, by face; `pixels`: of all strips
};

}  // namespace tessera
