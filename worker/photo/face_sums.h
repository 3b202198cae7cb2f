// Reduces pixel derivatives to faces: sums over the pixels of a view that see a face, weighted by barycentric
// coordinates.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"
#include "worker/photo/reference_strip.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {

// Per corner: derivative and curvature along the normal. Per face: pairs.
struct FaceSums {
  std::array<float, 3> gradient = {0, 0, 0};
  std::array<float, 3> curvature = {0, 0, 0};
  float pairs = 0;  // mean number of pairs per pixel of the face, summed over views
};

// Buffer of FaceGatherer::AddStrip, one per thread, reused between calls.
struct FaceSlots {
  uint32_t call = 0;
  // Per face: the index of its entry in the current list and, in the upper half, the call that wrote it, so that the
  // buffer need not be cleared.
  std::vector<uint64_t> slots;
};

// Reduces one view, strip by strip. Strips may be added in any order and from any thread with the same result.
class FaceGatherer {
 public:
  // Starts a view with strips 0 .. strips - 1. `own`: flags of the faces to sum; empty: all. The references must stay
  // valid until Finish.
  void Begin(const TriangleMesh& mesh, const PosedCamera& camera, const FaceMap& map, const std::vector<uint8_t>& own,
             int strips);
  // Marks a strip as empty.
  void SkipStrip(int strip) { parts_[strip].clear(); }
  // Adds the planes of a finished strip. Thread-safe for different strips and slots.
  void AddStrip(int strip, const ReferenceStrip& planes, FaceSlots* slots);
  // Adds the view to `sums`, one entry per face.
  void Finish(std::vector<FaceSums>* sums);

 private:
  // Moments of one strip's pixels of a face: sums of g z, h z, g z x, h z x, g z y, h z y, of the pairs, and of 1. x
  // and y are relative to the face's first pixel. Moments suffice because a barycentric coordinate is z times an
  // affine function of the pixel.
  struct Moments {
    int32_t face = -1;
    int32_t x0 = 0, y0 = 0;
    std::array<float, 8> sums = {};
  };
  struct Part {
    int32_t face = -1;
    FaceSums sums;  // `pairs` before division by the pixels
    float pixels = 0;
  };
  Part ToCorners(const Moments& moments) const;

  const TriangleMesh* mesh_ = nullptr;
  const PosedCamera* camera_ = nullptr;
  const FaceMap* map_ = nullptr;
  const std::vector<uint8_t>* own_ = nullptr;
  std::vector<std::vector<Part>> parts_;  // per strip
  std::vector<uint8_t> strips_of_face_;   // of each face: 0, 1, or 2 for two or more strips; zero between views
};

}  // namespace tessera
