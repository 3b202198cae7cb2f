// Sheet::colors: colours of the vertices of a sheet from photographs.
#pragma once

#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/exporting/export_format.h"
#include "common/exporting/sheet.h"

namespace tessera {

// Per vertex of `input.sheet`, by ColorPoints; input.neighbours hide vertices, and complete the normals on the border,
// so that a vertex has the same colour in all its sheets. Photographs that are finer than half of the mean edge at a
// vertex are averaged to pixels of at most that size. A vertex that no view sees has the mean colour of its neighbours
// in the mesh, nearest first; kUnknownColor in a connected part that no view sees. `unseen_share`, if not null: the
// share of such vertices. Errors as ColorPoints.
Status ColorSheet(const SheetInput& input, std::vector<Rgb>* colors, const TaskControl& control,
                  double* unseen_share = nullptr);

}  // namespace tessera
