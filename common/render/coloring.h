// What a surface is coloured by: classes, displacement from another surface, wrong labels, normals.
#ifndef TESSERA_COMMON_RENDER_COLORING_H_
#define TESSERA_COMMON_RENDER_COLORING_H_

#include <array>
#include <cstdint>
#include <vector>

#include "common/geometry/nearest_surface.h"
#include "common/geometry/mesh.h"
#include "common/render/renderer.h"

namespace tessera {

using Palette = std::vector<std::array<uint8_t, 3>>;  // RGB a class

// Everything that these functions are given must outlive what they return.

SurfaceColor UniformColor(const Color& color);

// The class's colour; pale pink where there is no label or no such class.
SurfaceColor LabelColor(const TriangleMesh& mesh, const Palette& palette);

// Grey where the label is that of the nearest face of `truth`, red where not, white where the truth has none.
SurfaceColor LabelErrorColor(const TriangleMesh& mesh, const TriangleMesh& truth, const NearestSurface& truth_surface);

// x, y, z of the face's normal as red, green, blue, from -1 to 1.
SurfaceColor NormalColor(const TriangleMesh& mesh);

// Signed distance of `point` from `reference`, metres: positive on the side to which the nearest face's normal looks.
double SignedDistance(const Eigen::Vector3d& point, const TriangleMesh& reference, const NearestSurface& surface);

// Blue (-1) over white (0) to red (1).
Color DivergingColor(double value);

// DivergingColor of SignedDistance / range_m.
SurfaceColor DisplacementColor(const TriangleMesh& reference, const NearestSurface& surface, double range_m);

// A round range (1, 2 or 5 times a power of ten, metres) that holds 90 % of the mesh's face centres, by area, of their
// distances from `reference`.
double DisplacementRange(const TriangleMesh& mesh, const NearestSurface& reference);

}  // namespace tessera

#endif  // TESSERA_COMMON_RENDER_COLORING_H_
