#include <Eigen/Geometry>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "common/imaging/image_io.h"
#include "common/job/change_cells.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "common/scene/photographs.h"
#include "common/storage/files.h"
#include "worker/changes/measure_changes.h"
#include "worker/tasks/refined_surface.h"
#include "worker/tasks/task_functions.h"

namespace tessera {
namespace {

constexpr int kWindowMargin_px = 16;  // margin around the compared windows

// The part of the image that may show the box; may be empty.
ImagePart PartThatShows(const PosedCamera& camera, const Eigen::AlignedBox3d& box) {
  const PinholeCamera& k = camera.intrinsics;
  Eigen::AlignedBox2d seen;
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3d p = camera.Project(box.corner(static_cast<Eigen::AlignedBox3d::CornerType>(corner)));
    if (p.z() <= 0) return {0, 0, k.width, k.height};
    seen.extend(p.head<2>());
  }
  const auto clamp = [](double x, int limit) {
    return static_cast<int>(std::clamp(x, 0.0, static_cast<double>(limit)));
  };
  return {clamp(seen.min().x() - kWindowMargin_px, k.width), clamp(seen.min().y() - kWindowMargin_px, k.height),
          clamp(seen.max().x() + kWindowMargin_px, k.width), clamp(seen.max().y() + kWindowMargin_px, k.height)};
}

// Bounds of everything that the sweep may read.
Eigen::AlignedBox3d SweptBox(const TriangleMesh& surface, const GroundPlane& ground, const Eigen::AlignedBox2d& plan,
                             const MeasureOptions& options) {
  const Eigen::Vector3d up = ground.axis_x.cross(ground.axis_y);
  double low_m = std::numeric_limits<double>::infinity(), high_m = -low_m;
  for (const Eigen::Vector3d& p : surface.vertices) {
    low_m = std::min(low_m, up.dot(p));
    high_m = std::max(high_m, up.dot(p));
  }
  Eigen::AlignedBox3d box;
  for (const double h : {low_m - options.below_m, high_m + options.above_m}) {
    for (int k = 0; k < 4; ++k) {
      const Eigen::Vector2d at = plan.corner(static_cast<Eigen::AlignedBox2d::CornerType>(k));
      box.extend(ground.axis_x * at.x() + ground.axis_y * at.y() + up * h);
    }
  }
  return box;
}

StatusOr<ChangeView> LoadView(const TaskRequest& request, const SceneView& view, int classes, const ImagePart& part) {
  ChangeView loaded;
  loaded.camera = view.camera;
  loaded.x0 = part.x0;
  loaded.y0 = part.y0;
  loaded.masked = view.masked;
  TESSERA_ASSIGN_OR_RETURN(loaded.luminance,
                           ReadLuminancePart(request.input_dir + "/" + view.image_path, view.lens, part,
                                             OptionsOf(request.input_dir, view)));
  if (view.likelihood_path.empty()) return loaded;
  TESSERA_ASSIGN_OR_RETURN(LikelihoodPart likelihoods,
                           ReadLikelihoodPart(request.input_dir + "/" + view.likelihood_path, classes, view.lens, part,
                                              view.likelihood_form));
  const PinholeCamera& whole = view.camera.intrinsics;
  loaded.likelihood_at.scale_x = static_cast<double>(likelihoods.whole_width) / whole.width;
  loaded.likelihood_at.scale_y = static_cast<double>(likelihoods.whole_height) / whole.height;
  loaded.likelihood_at.first_x = likelihoods.x0;
  loaded.likelihood_at.first_y = likelihoods.y0;
  loaded.likelihoods = std::move(likelihoods.pixels);
  return loaded;
}

}  // namespace

StatusOr<TaskOutcome> RunCompare(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const CompareParameters parameters, ParseCompareParameters(request.parameters));
  TESSERA_ASSIGN_OR_RETURN(const std::string survey_json, ReadFile(InputPath(request, kPlainSurveyFile)));
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(survey_json));
  TESSERA_ASSIGN_OR_RETURN(const CityReader city, CityReader::Open(InputPath(request, kCityFile)));
  for (const int32_t view : parameters.views) {
    if (view >= 0 && view < static_cast<int32_t>(survey.views.size())) continue;
    return absl::InvalidArgumentError("compare: found view " + std::to_string(view) + " of " +
                                      std::to_string(survey.views.size()));
  }
  GroundPlane ground = survey.ground;
  ground.cell_m = ChangeCellSize_m(survey.gsd_m);
  const Eigen::AlignedBox2d plan = PlanOf(parameters.cells, ground.cell_m, kBlockMargin);
  TESSERA_ASSIGN_OR_RETURN(const StatesOfTiles states, OpenStates(request, parameters.states));
  TESSERA_ASSIGN_OR_RETURN(const CollectedFaces faces, RefinedSurface(city, ground, plan, states));
  const TriangleMesh& surface = faces.mesh;
  ChangeRaster raster(parameters.cells, ground.cell_m);
  size_t used = 0;
  if (!surface.faces.empty()) {
    const MeasureOptions options;
    const Eigen::AlignedBox3d swept = SweptBox(surface, ground, plan, options);
    std::vector<PosedCamera> cameras;
    for (const int32_t view : parameters.views) cameras.push_back(survey.views[view].camera);
    std::vector<ChangeView> views;
    for (const int v : ViewsToMeasure(surface, ground, parameters.cells, cameras, survey.gsd_m, options)) {
      TESSERA_RETURN_IF_ERROR(control.Check());
      control.Report(0.5 * static_cast<double>(v) / static_cast<double>(cameras.size()), "reading images");
      const ImagePart part = PartThatShows(cameras[v], swept);
      if (part.x1 <= part.x0 || part.y1 <= part.y0) continue;
      TESSERA_ASSIGN_OR_RETURN(ChangeView loaded, LoadView(request, survey.views[parameters.views[v]],
                                                           static_cast<int>(survey.classes.size()), part));
      views.push_back(std::move(loaded));
    }
    control.Report(0.5, "comparing");
    const int classes = survey.has_likelihoods ? static_cast<int>(survey.classes.size()) : 0;
    raster = MeasureChanges(surface, ground, parameters.cells, views, classes, survey.gsd_m, options);
    used = views.size();
  }
  const std::string file = ChangeBlockFile(parameters.cells);
  TESSERA_RETURN_IF_ERROR(EnsureFolder(std::filesystem::path(OutputPath(request, file)).parent_path().string()));
  TESSERA_RETURN_IF_ERROR(WriteChangeRaster(OutputPath(request, file), raster));
  TaskOutcome outcome;
  outcome.outputs = {file};
  outcome.stats = nlohmann::json{{"views", used}, {"seconds", SecondsSince(clock, start_us)}}.dump();
  return outcome;
}

}  // namespace tessera
