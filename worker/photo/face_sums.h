// From pixels to faces: sums over the pixels of a view that see a face, weighted with its corners' barycentric weights.
#ifndef TESSERA_WORKER_PHOTO_FACE_SUMS_H_
#define TESSERA_WORKER_PHOTO_FACE_SUMS_H_

#include <array>
#include <cstdint>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"
#include "worker/photo/reference_strip.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {

// Scalars a face corner: derivative, curvature; and a face: pairs.
struct FaceSums {
  std::array<float, 3> gradient = {0, 0, 0};
  std::array<float, 3> curvature = {0, 0, 0};
  float pairs = 0;  // mean over the face's pixels of the pairs that count there, summed over views
};

// Buffer of FaceGatherer::AddStrip, reused from call to call; one a thread.
struct FaceSlots {
  uint32_t call = 0;
  // Of every face: where its entry of the list at hand is, and in the upper half the call it was written in, so that
  // nothing need be cleared.
  std::vector<uint64_t> slots;
};

// Gathers one view, strip by strip. Strips may come in any order and from any threads; the result is the same.
class FaceGatherer {
 public:
  // Begins a view whose strips are numbered 0 .. strips - 1. `own`: flags of the faces that are wanted; empty: all.
  // References must live until Finish.
  void Begin(const TriangleMesh& mesh, const PosedCamera& camera, const FaceMap& map, const std::vector<uint8_t>& own,
             int strips);
  // A strip that has nothing to add.
  void SkipStrip(int strip) { parts_[strip].clear(); }
  // The planes of a finished strip. Safe to call concurrently for different strips and slots.
  void AddStrip(int strip, const ReferenceStrip& planes, FaceSlots* slots);
  // Adds the view to `sums`, one entry a face.
  void Finish(std::vector<FaceSums>* sums);

 private:
  // Sums over the pixels of one strip that see a face: of g z, h z, g z x, h z x, g z y, h z y with x and y from the
  // first of them, since a corner's weight is z times a linear function of the pixel; of the pairs; and of ones.
  struct Moments {
    int32_t face = -1;
    int32_t x0 = 0, y0 = 0;
    std::array<float, 8> sums = {};
  };
  struct Part {
    int32_t face = -1;
    FaceSums sums;  // `pairs` not yet divided by pixels
    float pixels = 0;
  };
  Part ToCorners(const Moments& moments) const;

  const TriangleMesh* mesh_ = nullptr;
  const PosedCamera* camera_ = nullptr;
  const FaceMap* map_ = nullptr;
  const std::vector<uint8_t>* own_ = nullptr;
  std::vector<std::vector<Part>> parts_;  // of each strip
  std::vector<uint8_t> strips_of_face_;   // how many strips have the face, at most 2; zero between views
};

}  // namespace tessera

#endif  // TESSERA_WORKER_PHOTO_FACE_SUMS_H_
