// Splits mesh files into sheets, and measures how far a result lies from its start.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/exporting/export_scene.h"
#include "common/exporting/sheet_splitter.h"
#include "common/meshio/mesh_content.h"

namespace tessera {

// Where a mesh file is split.
struct SplitFileOptions {
  MeshReadOptions read;
  std::vector<SheetId> allowed;  // SplitOptions::allowed
  std::string scratch_folder;    // takes as much as the mesh file
  std::string sheets_folder;     // receives the sheets
};

// Splits a mesh file in the scene's coordinates. Reads it sequentially; if its labels are those of vertices, it is
// loaded. INVALID_ARGUMENT if the file is damaged, has no faces, or a label is no class of the scene; errors of
// SheetSplitter::Finish.
StatusOr<std::vector<SheetEntry>> SplitMeshFile(const std::string& path, const ExportScene& scene,
                                                const SplitFileOptions& options, const TaskControl& control);

// The distance in metres of each vertex of `sheet` to the surface of `start`: the same sheet of the start mesh and its
// neighbours. A vertex on a border has the same distance in all sheets unless it is farther from the start than a sheet
// is wide. INVALID_ARGUMENT if `start` has no faces.
StatusOr<std::vector<float>> DisplacementOf(const Sheet& sheet, std::span<const Sheet> start);

}  // namespace tessera
