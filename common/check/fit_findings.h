// What the fit of a scene (MeasureFit) says to its user.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/check/fit.h"
#include "common/check/fit_readings.h"
#include "common/check/tie_points.h"

namespace tessera {

// What may be wrong with the whole scene. `all_views_see`: each view sees the front of the mesh.
ReadingSearch SearchFor(const SceneFit& fit, double gsd_m, bool all_views_see);

// INVALID_ARGUMENT if images, poses and mesh correlate no better than by chance, with the reading that would fit. Adds
// warnings about misplaced views, poses, focal lengths, a shifted mesh and a bad fit.
Status JudgeFit(const SceneDescription& scene, const SceneFit& fit, const Reading& reading, double gsd_m,
                Warnings* warnings);

struct JudgedFit {
  SceneFit fit;
  Status fault;              // of JudgeFit
  bool has_reading = false;  // that explains what is wrong
};

// MeasureFit, FindReading if needed, and JudgeFit. `gsd_m`: 0 if no camera sees the mesh. `all_views_see`: as
// in SearchFor. `fetch`: as InspectedFiles.
StatusOr<JudgedFit> CheckFit(const SceneDescription& scene, const FitSurface& surface, double gsd_m, bool all_views_see,
                             const TaskControl& control, Warnings* warnings, const FetchFiles& fetch = {});

// Adds the fault, if it is one, to `faults`, with the option that makes it a warning; `anyway`: to `warnings`.
// `although`: what would be wrong then, such as "images, poses and mesh do not fit".
void AddAvoidableFault(const Status& fault, const char* although, bool anyway, Faults* faults, Warnings* warnings);
void AddFitFault(const JudgedFit& judged, bool anyway, Faults* faults, Warnings* warnings);

// The fit by camera and by image.
struct FitTable {
  struct Row {
    std::string name;  // of the image; of a camera: its size and focal length
    FitShare share;
    double reprojection_px = -1;  // median of an image's points; -1: none
    bool disagrees = false;       // with the others
  };
  FitShare all;
  std::vector<Row> cameras;
  std::vector<Row> images;  // with measured pairs or points; the worst first
};

// `tie_points` may be null.
FitTable MakeFitTable(const SceneDescription& scene, const SceneFit& fit, const TiePointFigures* tie_points);

// Rows under a header; at most `most_rows` cameras and as many images. Empty for an empty table.
std::string FitTableToText(const FitTable& table, size_t most_rows);

// An object with the figures of the whole scene, `cameras` and the `most_images` worst `images`. What was not measured
// is left out. The units are in the keys.
std::string FitTableToJson(const FitTable& table, size_t most_images);

// "88 % of 13225 patches above chance; median offset ...", or "not measured: ..."
std::string FitText(const SceneFit& fit);

}  // namespace tessera
