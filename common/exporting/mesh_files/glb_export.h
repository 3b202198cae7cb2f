// The export format `glb`: one binary glTF 2.0 file with the whole mesh.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/exporting/export_format.h"

namespace tessera {

inline constexpr int64_t kMostGlbTriangles = 4'000'000;

// Writes kPartFile: the sheet with positions of GlobeMap, and its colours unless options.color is kClass.
StatusOr<std::vector<std::string>> WriteGlbPart(const SheetInput& input, const std::string& folder,
                                                const TaskControl& control);

// Writes mesh.glb. Positions are metres, x east, y up, z south of an origin (GlobeMap): floats about the centre of the
// mesh, which is the translation of the only node. Each class has a primitive and a material with its name. COLOR_0 and
// white materials have the colours of options.color, materials the colours of the classes if that is kClass.
// asset.extras has the origin (`origin`: WGS 84), a point in the coordinates of options.crs (`crs`, `reference_point`),
// what the colours mean, and the number of triangles before a simplification: a mesh of more than `most_triangles` is
// simplified (ClusteredMesh) to fewer. Holds the triangles that it writes.
StatusOr<std::vector<std::string>> JoinGlbOf(const JoinInput& input, const std::string& folder,
                                             const TaskControl& control, int64_t most_triangles);
// With kMostGlbTriangles.
StatusOr<std::vector<std::string>> JoinGlb(const JoinInput& input, const std::string& folder,
                                           const TaskControl& control);

}  // namespace tessera
