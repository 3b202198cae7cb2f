// An estimate of a job's survey from the scene alone, to tell beforehand whether the job can be planned.
#pragma once

#include "common/geometry/mesh.h"
#include "common/job/survey.h"
#include "common/scene/scene.h"

namespace tessera {

// The cells of `mesh` (local frame, before splitting; must have a face) and their views as ingest finds them, but
// without tests of occlusion and with at most 40 views per cell, those of the finest resolution. The numbers of faces
// after splitting are estimated from 50,000 faces. Pairs: each view and the nearest four that show a
// common cell from directions at most 45 degrees apart. Precondition: gsd_m > 0. Does not depend on the number of
// threads.
Survey EstimateSurvey(const SceneDescription& scene, const TriangleMesh& mesh, double gsd_m);

}  // namespace tessera
