// Merges the tiles of a mesh into one PLY, tile by tile, so that memory holds one tile and the rims of all.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/importing/class_map.h"
#include "common/importing/mesh_source.h"
#include "common/scene/scene.h"

namespace tessera {

enum class LabelSource { kNone, kMaterial, kProperty };

struct MergeOptions {
  LabelSource labels = LabelSource::kNone;
  std::string label_property;  // kProperty: of a PLY's faces or vertices, or of a glTF's vertices
  // The classes of the scene; labels are indices into it. Classes that only `class_map` names are appended.
  std::vector<std::string> classes;
  // kMaterial: materials that it lacks must have the name of a class. kProperty: if it is empty, labels stay as they
  // are; else it names every label.
  ClassMap class_map;
  // From file coordinates + MeshSource::offset to coordinates of the scene, in metres. Empty: the identity.
  std::function<Eigen::Vector3d(const Eigen::Vector3d&)> scene_from_source;
  double weld_m = 1e-3;  // vertices on rims of different tiles become one up to this distance
  TaskControl control;
};

// A material or label that the mesh uses.
struct LabelUse {
  std::string name;
  int64_t faces = 0;
  int32_t label = -1;  // index into MergedMesh::classes
};

struct MergedMesh {
  int64_t vertices = 0, faces = 0;
  std::vector<int64_t> tile_faces;   // in the order of MeshSource::files
  std::vector<PlanRect> tile_rects;  // the same: as SceneSource::tile_rects
  int64_t welded_vertices = 0;       // replaced by a vertex of an earlier tile
  int64_t collapsed_faces = 0;       // left out, because welding joined two of their corners
  int64_t faces_without_class = 0;   // 0 without labels
  Eigen::AlignedBox3d bounds;        // coordinates of the scene
  std::vector<std::string> classes;  // of MergeOptions, and those of its map; empty without labels
  std::vector<LabelUse> labels;      // in the order of their first use; by number for kProperty
};

// Writes the tiles to `out_ply` as binary PLY with double coordinates and, unless there are no labels, int `label`.
// Tiles follow each other in the order of `source`; vertices and faces keep their order, and what a single file has
// (duplicate vertices, holes) stays. The result does not depend on threads. The file appears when it is complete;
// while it is made, its folder needs twice its space for temporary files.
//
// Warns as the readers of the formats do. INVALID_ARGUMENT with the faults of all tiles: damaged files, coordinates
// that `scene_from_source` cannot convert (not finite), materials or labels without a class, with what to write into
// the file of --classes. RESOURCE_EXHAUSTED if the disk is full; CANCELLED.
StatusOr<MergedMesh> MergeMeshes(const MeshSource& source, const MergeOptions& options, const std::string& out_ply,
                                 Warnings* warnings);

}  // namespace tessera
