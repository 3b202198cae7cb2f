#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/scene/check.h"
#include "common/scene/scene.h"
#include "common/storage/files.h"
#include "common/tile/survey.h"
#include "common/tile/task_parameters.h"
#include "worker/city/local_grid.h"
#include "worker/city/update_survey.h"
#include "worker/tasks/stages.h"

namespace tessera {
namespace {

// What the files of the views decode to: known for those of the base, read for the others.
Status FillContents(const UpdateFiles& files, const TaskControl& control, SceneDescription* scene) {
  std::vector<Status> statuses(scene->views.size());
  ParallelFor(static_cast<int64_t>(scene->views.size()), 1, [&](int64_t begin, int64_t end) {
    for (int64_t v = begin; v < end; ++v) {
      if (!control.Check().ok()) return;
      SceneView& view = scene->views[v];
      SceneView unread = view;
      const auto take = [&](std::string* path, std::string* content) {
        const auto known = files.known.find(*path);
        if (known == files.known.end()) return;
        *content = known->second.content;
        path->clear();
      };
      take(&unread.image_path, &view.image_content);
      take(&unread.likelihood_path, &view.likelihood_content);
      const auto content = ReadPixelContent(scene->folder, unread, static_cast<int>(scene->classes.size()));
      statuses[v] = content.status();
      if (!content.ok()) continue;
      if (!content->image.empty()) view.image_content = content->image;
      if (!content->likelihood.empty()) view.likelihood_content = content->likelihood;
    }
  });
  Faults faults;
  for (const Status& status : statuses) faults.Add(status);
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  return control.Check();
}

}  // namespace

StatusOr<TaskOutcome> RunUpdate(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const UpdateParameters parameters, ParseUpdateParameters(request.parameters));
  TESSERA_ASSIGN_OR_RETURN(const std::string files_json, ReadFile(InputPath(request, kFilesFile)));
  TESSERA_ASSIGN_OR_RETURN(const UpdateFiles files, ParseUpdateFiles(files_json));
  TESSERA_ASSIGN_OR_RETURN(const std::string survey_json, ReadFile(InputPath(request, kBaseSurveyFile)));
  TESSERA_ASSIGN_OR_RETURN(Survey survey, ParseSurvey(survey_json));
  TESSERA_ASSIGN_OR_RETURN(const CityReader city, CityReader::Open(InputPath(request, kCityFile)));
  control.Report(0, "reading the scene");
  SceneLoadOptions load;
  for (const auto& [path, known] : files.known) load.elsewhere.insert(path);
  load.needs_mesh = false;
  load.frame = Frame::Of(survey.crs, survey.origin_in_scene, survey.rotation_local_from_scene);
  TaskOutcome outcome;
  TESSERA_ASSIGN_OR_RETURN(SceneDescription scene,
                           LoadScene(InputPath(request, kSceneFolder), &outcome.warnings, load));
  const bool whole = !scene.mesh_path.empty();
  if (whole) {
    const auto mesh = files.known.find(scene.mesh_path);
    if (mesh == files.known.end() || !mesh->second.mesh) {
      return InputError(absl::StrCat(scene.folder, "/", scene.mesh_path), "", "another mesh than the base's",
                        "the same file, or none: run a scene with a new mesh as a job of its own");
    }
    survey.mesh_path = scene.mesh_path;
  } else if (const auto mesh = files.carried.find(survey.mesh_path); mesh != files.carried.end()) {
    survey.mesh_path = mesh->second;
  }
  for (SceneView& view : scene.views) view.camera = OnLocalGrid(view.camera);
  TESSERA_RETURN_IF_ERROR(FillContents(files, PartOf(control, 0, 0.6), &scene));

  TESSERA_ASSIGN_OR_RETURN(const ViewChanges changes, TakeViews(scene, whole, parameters, files.carried, &survey));
  CellViewOptions options;
  options.choice.views_per_direction =
      parameters.ingest.views_per_direction.value_or(options.choice.views_per_direction);
  PairOptions pairs;
  pairs.partners = parameters.ingest.partners.value_or(pairs.partners);
  TESSERA_RETURN_IF_ERROR(
      ChooseAnew(city, changes, parameters.all_epochs, options, pairs, PartOf(control, 0.6, 0.95), &survey));
  FillViewDepths(&survey);
  if (changes.snapped > 0) {
    outcome.warnings.push_back(absl::StrCat(changes.snapped, " poses differ from the base's by less than ", kSnap_px,
                                            " px all over their images: the base's are kept"));
  }
  survey.warnings.insert(survey.warnings.end(), outcome.warnings.begin(), outcome.warnings.end());

  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(OutputPath(request, kSurveyFile), SurveyToJson(survey)));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(OutputPath(request, kPlainSurveyFile), SurveyToJson(WithoutNames(survey))));
  outcome.outputs = {kSurveyFile, kPlainSurveyFile};
  outcome.stats = nlohmann::json{{"views", survey.views.size()},
                                 {"added", changes.added},
                                 {"withdrawn", changes.withdrawn},
                                 {"moved", changes.moved},
                                 {"replaced", changes.replaced},
                                 {"snapped", changes.snapped},
                                 {"seconds", SecondsSince(clock, start_us)}}
                      .dump();
  return outcome;
}

}  // namespace tessera
