// Label fields with the structure of a real mesh's, made at random.
#pragma once

#include <cstdint>

#include "worker/label/label_field.h"

namespace tessera {

struct MeshFieldOptions {
  int faces = 20000;  // about
  int classes = 4;
  uint64_t seed = 1;
  double patch_faces = 400;         // faces of a patch of one class, on average
  double contrast = 2;              // by how much a face's own class leads, in nats
  double face_noise = 1;            // standard deviation of the costs' errors that are independent from face to face
  double wrong_area = 0.12;         // share of the area where the classifier errs patch by patch
  double unseen_area = 0.1;         // share of the area that no view sees: nothing is known there
  double coupling = 0.5;            // Potts weight of an edge as long as that of an average face
  double cell_gsd = kLabelCellGsd;  // side of the cells, where a face has 12 GSD² on average
  bool shuffled = false;            // faces in random order instead of row by row
};

// Field over a jittered grid of squares that are cut in two along a random diagonal; costs grow with area, weights with
// length.
LabelField MakeMeshField(const MeshFieldOptions& options);

}  // namespace tessera
