// Colourings of surfaces: by class, displacement from another surface, wrong labels, normals.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/geometry/nearest_surface.h"
#include "common/render/renderer.h"

namespace tessera {

using Palette = std::vector<std::array<uint8_t, 3>>;  // RGB of each class

// The arguments of these functions must outlive the returned colouring.

SurfaceColor UniformColor(const Color& color);

// The colour of the face's class; pale pink for faces without a label or with a class outside the palette.
SurfaceColor LabelColor(const TriangleMesh& mesh, const Palette& palette);

// Grey where the label equals that of the nearest face of `truth`, red where it differs, white where the truth has
// none.
SurfaceColor LabelErrorColor(const TriangleMesh& mesh, const TriangleMesh& truth, const NearestSurface& truth_surface);

// x, y, z of the face's normal, from -1 to 1, as red, green, blue.
SurfaceColor NormalColor(const TriangleMesh& mesh);

// Signed distance in metres of `point` from `reference`: positive on the side of the nearest face's normal.
double SignedDistance(const Eigen::Vector3d& point, const TriangleMesh& reference, const NearestSurface& surface);

// A diverging colour scale: blue (-1), white (0), red (1).
Color DivergingColor(double value);

// DivergingColor of SignedDistance / range_m.
SurfaceColor DisplacementColor(const TriangleMesh& reference, const NearestSurface& surface, double range_m);

// The range in metres for DisplacementColor: the 90 % quantile (weighted by area) of the distances of face centres from
// `reference`, rounded up to 1, 2 or 5 times a power of ten.
double DisplacementRange(const TriangleMesh& mesh, const NearestSurface& reference);

}  // namespace tessera
