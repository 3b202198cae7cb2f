#include "server/plan/classify_tasks.h"

#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

// Ignore surfaces whose pixel size exceeds the survey's GSD by this factor.
constexpr double kFarthestGsd = 16;

}  // namespace

std::vector<PlannedTask> PlanClassify(const ClassifyWork& work) {
  const Survey& survey = work.survey;
  const std::vector<Prediction> predicted = PredictClassify(survey);
  std::vector<PlannedTask> tasks;
  PlannedTask borders;
  borders.kind = borders.name = kBordersKind;
  borders.parameters =
      ToJson(BordersParameters{static_cast<int>(survey.classes.size()), {work.views.begin(), work.views.end()}});
  for (const int32_t v : work.views) {
    SceneView view = survey.views[v];
    view.name.clear();
    view.image_path.clear();
    if (!view.mask_path.empty()) view.mask_path = ViewMaskName(v);
    view.flight = -1;
    ClassifyParameters parameters;
    parameters.view = v;
    parameters.view_json = ViewsToJson({view});
    parameters.classes_json = ClassesToJson(survey.classes);
    parameters.up.assign(survey.up.begin(), survey.up.end());
    parameters.gsd_m = survey.gsd_m;
    // Depends on the camera only, so that other images of an update do not change the task.
    parameters.depth_m = kFarthestGsd * survey.gsd_m * view.camera.intrinsics.fx;
    parameters.by_default_rule = work.classifier_file < 0;
    PlannedTask task;
    task.kind = kClassifyKind;
    task.name = absl::StrCat(kClassifyKind, " view ", v);
    task.parameters = ToJson(parameters);
    SetCost(predicted[v], &task);
    task.inputs = {{work.city_from, kCityFile}};
    if (work.classifier_file >= 0) task.scene_files.Edit() = {work.classifier_file};
    task.view_files.Edit() = work.files_of_view[v];
    borders.inputs.push_back({TaskId(static_cast<int>(work.first_task + tasks.size())), ViewBordersName(v)});
    tasks.push_back(std::move(task));
  }
  if (work.borders) tasks.push_back(std::move(borders));
  return tasks;
}

}  // namespace tessera
