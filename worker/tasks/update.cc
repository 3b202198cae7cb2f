#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/check/check.h"
#include "common/geometry/repair.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "common/scene/repair_options.h"
#include "common/scene/scene.h"
#include "common/scene/scene_json.h"
#include "common/storage/files.h"
#include "worker/city/disk_mesh.h"
#include "worker/city/local_grid.h"
#include "worker/city/revise_city.h"
#include "worker/city/update_survey.h"
#include "worker/tasks/classified_views.h"
#include "worker/tasks/task_functions.h"

namespace tessera {
namespace {

// The base's views with images that the update does not read, by the image's path.
std::map<std::string, const SceneView*> KnownImages(const UpdateFiles& files, const Survey& base) {
  std::map<std::string, const SceneView*> of_content, found;
  for (const SceneView& view : base.views) of_content.emplace(view.image_content, &view);
  for (const auto& [path, known] : files.known) {
    const auto view = of_content.find(known.content);
    if (!known.content.empty() && view != of_content.end()) found.emplace(path, view->second);
  }
  return found;
}

// The forms of the base's likelihood files, by their path.
std::map<std::string, LikelihoodForm> KnownForms(const Survey& base, const UpdateFiles& files) {
  std::map<std::string, LikelihoodForm> known;
  for (const SceneView& view : base.views) {
    const auto carried = files.carried.find(view.likelihood_path);
    if (carried != files.carried.end()) known[carried->second] = view.likelihood_form;
  }
  return known;
}

// Sets how photographs and likelihoods are read: as the base did for those that it knows.
Status FillForms(const std::map<std::string, const SceneView*>& known,
                 const std::map<std::string, LikelihoodForm>& known_forms, const InspectedFiles& files,
                 const TaskControl& control, SceneDescription* scene, Warnings* warnings) {
  std::vector<uint8_t> is_read(scene->views.size(), 1);
  for (size_t v = 0; v < scene->views.size(); ++v) {
    SceneView& view = scene->views[v];
    const auto of_base = known.find(view.image_path);
    if (of_base == known.end()) continue;
    if (!view.mask_path.empty()) {
      return InputError(absl::StrCat(scene->folder, "/", view.mask_path), "", "a mask of an image that had none",
                        "the masks of the base job for its images: remove it, or submit a new job");
    }
    is_read[v] = 0;
    view.masked = of_base->second->masked;
    view.white_level = of_base->second->white_level;
  }
  return CompletePixelForms(is_read, known_forms, files, control, scene, warnings);
}

// Hashes of the decoded content of the views' files: known for the base's views, inspected or computed for the others.
Status FillContents(const UpdateFiles& files, const InspectedFiles& inspected, const TaskControl& control,
                    SceneDescription* scene) {
  const int classes = static_cast<int>(scene->classes.size());
  std::vector<SceneView> new_files = scene->views;  // with the paths of these alone
  std::vector<const ViewInspection*> inspections;
  std::vector<std::string> unknown;
  for (size_t v = 0; v < scene->views.size(); ++v) {
    SceneView& view = scene->views[v];
    SceneView& unread = new_files[v];
    const auto take = [&](std::string* path, std::string* content) {
      const auto known = files.known.find(*path);
      if (known == files.known.end()) return;
      *content = known->second.content;
      path->clear();
    };
    take(&unread.image_path, &view.image_content);
    take(&unread.likelihood_path, &view.likelihood_content);
    if (const auto known = files.known.find(view.image_path); known != files.known.end()) {
      if (!known->second.classified.empty()) view.likelihood_content = known->second.classified;
    }
    const ViewInspection* const found = inspected.inspections.Find(unread, classes);
    const bool is_good = found != nullptr && found->broken.ok();  // else the errors of all files of the view are told
    inspections.push_back(is_good ? found : nullptr);
    if (!is_good) {
      unknown.insert(unknown.end(), {unread.image_path, unread.mask_path, unread.likelihood_path});
    }
  }
  TESSERA_RETURN_IF_ERROR(FetchInScene(scene->folder, unknown, inspected.fetch));
  std::vector<Status> statuses(scene->views.size());
  ParallelForEach(scene->views.size(), 1, [&](int64_t v) {
    if (!control.Check().ok()) return;
    SceneView& view = scene->views[v];
    const ViewInspection* const found = inspections[v];
    const StatusOr<PixelContent> content =
        found != nullptr ? found->content : ReadPixelContent(scene->folder, new_files[v], classes);
    statuses[v] = content.status();
    if (!content.ok()) return;
    if (!content->image.empty()) {
      view.image_content = content->image;
      view.masked = content->masked_share > 0;
    }
    if (!content->likelihood.empty()) view.likelihood_content = content->likelihood;
  });
  Faults faults;
  for (const Status& status : statuses) faults.Add(status);
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  return control.Check();
}

// The mesh of the base job.
struct BaseMesh {
  std::string path;  // relative to the scene's folder
  std::optional<std::string> label_property;
  std::vector<SceneView> views;  // of the base job
};

// Updates the base's city to the scene's mesh and writes it.
Status ReviseMesh(const SceneDescription& scene, const BaseMesh& base_mesh, const TaskRequest& request,
                  const CityReader& city, const TaskControl& control, Survey* survey, Warnings* warnings) {
  TESSERA_ASSIGN_OR_RETURN(const TempFolder scratch_folder, TempFolder::Create(request.output_dir, "scratch-"));
  const std::string& scratch = scratch_folder.path();
  control.Report(0, "reading the meshes");
  MeshDefects defects, of_base;
  TESSERA_ASSIGN_OR_RETURN(DiskMesh now, ReadMeshToDisk(scene, scratch, warnings));
  survey->input_vertices = static_cast<int64_t>(now.vertices.size());
  survey->input_faces = static_cast<int64_t>(now.faces.size());
  const std::string path = absl::StrCat(scene.folder, "/", scene.mesh_path);
  RepairOptions repair = RepairOptionsOf(survey->views, scene.frame);
  repair.file_origin = OnLocalGrid(repair.file_origin);
  repair.scratch_folder = scratch;
  repair.file = path;
  TESSERA_ASSIGN_OR_RETURN(now, RepairOnDisk(std::move(now), scratch, DiskPassOptions(), repair, &defects));
  WarnOfDefects(defects, warnings);
  if (now.float_positions) TESSERA_RETURN_IF_ERROR(CheckFloatRounding(path, now.largest_coordinate_m, survey->gsd_m));
  if ((now.labels.size() > 0) != survey->has_labels) {
    return InputError(
        path, "", survey->has_labels ? "no labels" : "labels",
        survey->has_labels ? "labels, as in the base job's mesh" : "no labels, as in the base job's mesh");
  }
  SceneDescription with_base_mesh = scene;
  with_base_mesh.mesh_path = base_mesh.path;
  // The base job may be older than the names of labels that are known now.
  with_base_mesh.label_property = survey->has_labels ? base_mesh.label_property : std::string();
  if (!FileExists(absl::StrCat(scene.folder, "/", base_mesh.path))) {
    return InputError(path, "", "a new mesh of another name", "a name that ends in .ply, .obj, .glb or .gltf");
  }
  TESSERA_ASSIGN_OR_RETURN(DiskMesh base, ReadMeshToDisk(with_base_mesh, scratch));
  repair.views = RepairOptionsOf(base_mesh.views, scene.frame).views;  // as the base job repaired it
  TESSERA_ASSIGN_OR_RETURN(base, RepairOnDisk(std::move(base), scratch, DiskPassOptions(), repair, &of_base));
  TESSERA_RETURN_IF_ERROR(CompleteLabels(survey->has_likelihoods, scratch, &now));
  TESSERA_RETURN_IF_ERROR(CompleteLabels(survey->has_likelihoods, scratch, &base));
  TESSERA_RETURN_IF_ERROR(control.Check());
  control.Report(0.4, "comparing the meshes");
  std::vector<PosedCamera> cameras;
  for (const SceneView& view : survey->views) {
    if (!view.withdrawn) cameras.push_back(view.camera);
  }
  TESSERA_ASSIGN_OR_RETURN(const RevisedCity revised, ReviseCity(city, base, now, survey->ground, cameras,
                                                                 DensityOptions(), scratch, PartOf(control, 0.4, 0.8)));
  if (revised.spans().mesh.faces.empty())
    return InputError(path, "", "only degenerate faces", "at least one face with an area");
  control.Report(0.8, "writing the city");
  std::map<std::pair<int, int>, std::vector<int32_t>> views;
  for (SurveyCell& cell : survey->cells) views[{cell.x, cell.y}] = std::move(cell.views);
  survey->cells = CellsOf(revised.spans().mesh, survey->ground);
  for (SurveyCell& cell : survey->cells) cell.views = std::move(views[{cell.x, cell.y}]);
  survey->revision = {city.face_ids_end(), {revised.changed_cells.begin(), revised.changed_cells.end()}};
  survey->vertices = static_cast<int64_t>(revised.mesh.vertices.size());
  survey->faces = static_cast<int64_t>(revised.mesh.faces.size());
  return WriteCity(OutputPath(request, kCityFile), revised.spans(), survey->ground, survey->cells, scratch);
}

}  // namespace

StatusOr<TaskOutcome> RunUpdate(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const UpdateParameters parameters, ParseUpdateParameters(request.parameters));
  TESSERA_ASSIGN_OR_RETURN(const std::string files_json, ReadFile(InputPath(request, kFilesFile)));
  TESSERA_ASSIGN_OR_RETURN(const UpdateFiles files, ParseUpdateFiles(files_json));
  TESSERA_ASSIGN_OR_RETURN(const std::string survey_json, ReadFile(InputPath(request, kBaseSurveyFile)));
  TESSERA_ASSIGN_OR_RETURN(Survey survey, ParseSurvey(survey_json));
  survey.revision.reset();
  TESSERA_ASSIGN_OR_RETURN(CityReader city, CityReader::Open(InputPath(request, kCityFile)));
  control.Report(0, "reading the scene");
  SceneLoadOptions load;
  for (const auto& [path, known] : files.known) load.elsewhere.insert(path);
  const std::map<std::string, const SceneView*> known_images = KnownImages(files, survey);
  for (const auto& [path, view] : known_images) {
    const PinholeCamera& camera = view->lens.pinhole;
    load.headers_elsewhere.emplace(path, ImageHeader{{camera.width, camera.height}});
  }
  load.needs_mesh = false;
  load.to_be_classified = !survey.classifier.empty();
  load.frame = Frame::Of(survey.crs, survey.origin_in_scene, survey.rotation_local_from_scene);
  TaskOutcome outcome;
  TESSERA_ASSIGN_OR_RETURN(const InspectedFiles inspected, ReadInspections(request, parameters.ingest));
  inspected.inspections.AddTo(&load);
  TESSERA_ASSIGN_OR_RETURN(SceneDescription scene,
                           LoadScene(InputPath(request, kSceneFolder), &outcome.warnings, load));
  const bool whole = !scene.mesh_path.empty();
  const auto known_mesh = files.known.find(scene.mesh_path);
  const bool other_mesh = whole && (known_mesh == files.known.end() || !known_mesh->second.mesh);
  if (const auto mesh = files.carried.find(survey.mesh_path); mesh != files.carried.end()) {
    survey.mesh_path = mesh->second;
  }
  const BaseMesh base_mesh = {survey.mesh_path, survey.label_property, survey.views};
  if (whole) {
    if (!other_mesh && scene.label_property != survey.label_property) {
      return InputError(absl::StrCat(scene.folder, "/scene.json"), "label_property",
                        "another value than in the base job, for the same mesh", "the base job's value, or a new job");
    }
    survey.mesh_path = scene.mesh_path;
    survey.label_property = scene.label_property;
  }
  if (scene.source) survey.source = SceneSourceToJson(*scene.source);
  for (SceneView& view : scene.views) view.camera = OnLocalGrid(view.camera);
  TESSERA_RETURN_IF_ERROR(
      FillForms(known_images, KnownForms(survey, files), inspected, control, &scene, &outcome.warnings));
  TESSERA_RETURN_IF_ERROR(FillContents(files, inspected, PartOf(control, 0, 0.4), &scene));
  if (!survey.classifier.empty()) {
    std::set<std::string> classified;
    for (const auto& [path, known] : files.known) {
      if (!known.classified.empty()) classified.insert(path);
    }
    TESSERA_RETURN_IF_ERROR(FillClassifiedContents(survey, classified, inspected, control, &scene));
  }

  TESSERA_ASSIGN_OR_RETURN(const ViewChanges changes, UpdateViews(scene, whole, parameters, files.carried, &survey));
  if (other_mesh) {
    TESSERA_RETURN_IF_ERROR(
        ReviseMesh(scene, base_mesh, request, city, PartOf(control, 0.4, 0.6), &survey, &outcome.warnings));
    TESSERA_ASSIGN_OR_RETURN(city, CityReader::Open(OutputPath(request, kCityFile)));
    outcome.outputs.push_back(kCityFile);
  }
  CellViewOptions options;
  options.choice.views_per_direction =
      parameters.ingest.views_per_direction.value_or(options.choice.views_per_direction);
  PairOptions pairs;
  pairs.partners = parameters.ingest.partners.value_or(pairs.partners);
  TESSERA_RETURN_IF_ERROR(
      UpdateViewSelection(city, changes, parameters.all_epochs, options, pairs, PartOf(control, 0.6, 0.95), &survey));
  FillViewDepths(&survey);
  if (changes.snapped > 0) {
    outcome.warnings.push_back(absl::StrCat(changes.snapped, " poses differ from those of the base job by less than ",
                                            kSnap_px, " px everywhere in the image: the base job's poses are used"));
  }
  survey.warnings.insert(survey.warnings.end(), outcome.warnings.begin(), outcome.warnings.end());

  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(OutputPath(request, kSurveyFile), SurveyToJson(survey)));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(OutputPath(request, kPlainSurveyFile), SurveyToJson(WithoutNames(survey))));
  outcome.outputs.insert(outcome.outputs.end(), {kSurveyFile, kPlainSurveyFile});
  outcome.stats =
      nlohmann::json{{"views", survey.views.size()},
                     {"added", changes.added},
                     {"withdrawn", changes.withdrawn},
                     {"moved", changes.moved},
                     {"replaced", changes.replaced},
                     {"snapped", changes.snapped},
                     {"new_faces", survey.revision ? city.face_ids_end() - survey.revision->first_new_face : 0},
                     {"seconds", SecondsSince(clock, start_us)}}
          .dump();
  return outcome;
}

}  // namespace tessera
