// Splits a city's mesh into sheets. Memory is bounded by one sheet.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/exporting/sheet.h"
#include "common/job/ground.h"
#include "common/storage/mapped_file.h"

namespace tessera {

// A sheet that was written.
struct SheetEntry {
  SheetId id;
  int64_t faces = 0, vertices = 0;
  Eigen::AlignedBox3d box;  // of its vertices, local frame, metres
};

struct SplitOptions {
  GroundPlane ground;
  bool has_confidence = false;    // AddFace gets the confidence of the label
  bool has_displacement = false;  // AddVertex gets the displacement
  // The sheets that may exist; a face of another sheet goes to the nearest of them (NearestSheet). Empty: all.
  std::vector<SheetId> allowed;
};

// The index of the sheet of `sheets`, which is not empty, with the smallest distance to `id`: between the squares, then
// the first by y, then x. Sheets that touch have distance 0.
size_t NearestSheet(const SheetId& id, const std::vector<SheetId>& sheets);

// Takes a mesh element by element, in the order of the city's mesh, and writes one file a sheet. Movable, not
// thread-safe. `scratch_folder` takes 32 bytes a vertex and 28 a face until the object is destroyed; the files there
// have no name.
class SheetSplitter {
 public:
  static StatusOr<SheetSplitter> Create(const std::string& scratch_folder, SplitOptions options);

  // `position`: metres, local frame.
  void AddVertex(const Eigen::Vector3d& position, float displacement_m = 0);
  // `face`: indices of vertices in the order of AddVertex; they may be added later.
  void AddFace(const Triangle& face, int32_t label, float confidence = 0);

  // Writes SheetPath of each sheet with faces to `folder`, which exists; returns the sheets by y, then x. Sheets have
  // the same bytes for every order of other sheets' elements. Call it once. INVALID_ARGUMENT if a face has a vertex
  // that does not exist or lies too far from the origin for a ground cell; RESOURCE_EXHAUSTED if the disk is full;
  // CANCELLED.
  StatusOr<std::vector<SheetEntry>> Finish(const std::string& folder, const TaskControl& control);

 private:
  SheetSplitter(std::string scratch_folder, SplitOptions options, ScratchList<Eigen::Vector3d> positions,
                ScratchList<float> displacements_m, ScratchList<Triangle> faces, ScratchList<int32_t> labels,
                ScratchList<float> confidence)
      : scratch_folder_(std::move(scratch_folder)),
        options_(std::move(options)),
        positions_(std::move(positions)),
        displacements_m_(std::move(displacements_m)),
        faces_(std::move(faces)),
        labels_(std::move(labels)),
        confidence_(std::move(confidence)) {}

  std::string scratch_folder_;
  SplitOptions options_;
  ScratchList<Eigen::Vector3d> positions_;
  ScratchList<float> displacements_m_;
  ScratchList<Triangle> faces_;
  ScratchList<int32_t> labels_;
  ScratchList<float> confidence_;
};

// The file of a sheet in a folder of sheets.
std::string SheetPath(const std::string& folder, const SheetId& id);

}  // namespace tessera
