#include <algorithm>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "common/check/check.h"
#include "common/check/coverage.h"
#include "common/check/fit_findings.h"
#include "common/geometry/coarse_mesh.h"
#include "common/geometry/repair.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "common/scene/repair_options.h"
#include "common/scene/scene.h"
#include "common/scene/scene_json.h"
#include "common/storage/files.h"
#include "worker/city/cell_views.h"
#include "worker/city/city_file.h"
#include "worker/city/disk_mesh.h"
#include "worker/city/local_grid.h"
#include "worker/photo/pairs.h"
#include "worker/refine/density.h"
#include "worker/tasks/classified_views.h"
#include "worker/tasks/task_functions.h"

namespace tessera {
namespace {

constexpr int64_t kCoverageClusters = 1 << 18;
constexpr double kCoarseFootprint_px2 = 64;  // of faces that are split again before the finest level
constexpr size_t kReportedImages = 20;  // the worst ones, in the report
constexpr int kMinPairSamples = 4000, kPairSamplesPerView = 100, kMaxPairSamples = 100000;

// Larger scenes are checked while their mesh is streamed, not in memory.
constexpr int64_t kMaxFacesInMemory = 4 << 20;

std::vector<PosedCamera> CamerasOf(const SceneDescription& scene) {
  std::vector<PosedCamera> cameras;
  for (const SceneView& view : scene.views) cameras.push_back(view.camera);
  return cameras;
}

// The sample faces of SelectPairs and MedianGsd, picked from the whole mesh.
TriangleMesh PairSamples(const MeshSpans& mesh, int samples) {
  const size_t step = std::max<size_t>(1, mesh.faces.size() / static_cast<size_t>(samples));
  std::vector<size_t> faces;
  for (size_t f = step / 2; f < mesh.faces.size(); f += step) faces.push_back(f);
  return PickFaces(mesh, faces);
}

TriangleMesh GsdSamples(const MeshSpans& mesh) {
  constexpr size_t kSamples = 4096;
  const size_t samples = std::min(mesh.faces.size(), kSamples);
  std::vector<size_t> faces;
  for (size_t i = 0; i < samples; ++i) faces.push_back(i * mesh.faces.size() / samples);
  return PickFaces(mesh, faces);
}

// Selects pairs and reorders the views so that paired views are close together, since memory during refinement
// depends on the distance in this order.
void FillPairs(const MeshSpans& mesh, const std::vector<PosedCamera>& cameras, const IngestParameters& parameters,
               Survey* survey) {
  PairOptions options;
  options.partners = parameters.partners.value_or(options.partners);
  const TriangleMesh picked = PairSamples(
      mesh, std::clamp(kPairSamplesPerView * static_cast<int>(cameras.size()), kMinPairSamples, kMaxPairSamples));
  options.samples = static_cast<int>(picked.faces.size());  // all of these
  const std::vector<ViewPair> pairs = SelectPairs(picked, cameras, options);
  const std::vector<int> order = OrderByPairs(static_cast<int>(cameras.size()), pairs);
  std::vector<int32_t> place(order.size());
  std::vector<SceneView> views;
  for (size_t i = 0; i < order.size(); ++i) {
    place[order[i]] = static_cast<int32_t>(i);
    views.push_back(std::move(survey->views[order[i]]));
  }
  survey->views = std::move(views);
  for (const ViewPair& pair : pairs) survey->pairs.push_back({place[pair.reference], place[pair.other]});
  std::sort(survey->pairs.begin(), survey->pairs.end());
}

// Reports what CheckScene would report of a mesh, for meshes that it leaves to ingest. `fit` receives the fit.
Status CheckLargeMesh(const SceneDescription& scene, const DiskMesh& mesh, const MeshDefects& defects, double gsd_m,
                      const std::string& scratch_folder, bool anyway, const FetchFiles& fetch,
                      const TaskControl& control, Warnings* warnings, std::string* fit) {
  const std::string path = absl::StrCat(scene.folder, "/", scene.mesh_path);
  WarnOfDefects(defects, warnings);
  const int64_t unlabelled = std::count(mesh.labels.values().begin(), mesh.labels.values().end(), -1);
  if (unlabelled > 0) warnings->push_back(absl::StrCat(scene.mesh_path, ": ", unlabelled, " faces have no label"));
  Faults faults;
  if (mesh.float_positions) faults.Add(CheckFloatRounding(path, mesh.largest_coordinate_m, gsd_m));
  TESSERA_ASSIGN_OR_RETURN(const CoarseMesh coarse, CoarsenMesh(mesh.spans(), kCoverageClusters, scratch_folder));
  TESSERA_ASSIGN_OR_RETURN(const Coverage coverage, MeasureCoverage(scene, coarse.mesh, 1, control));
  if (faults.empty()) {
    TaskControl silent = control;
    silent.report = {};
    TESSERA_ASSIGN_OR_RETURN(const JudgedFit judged, CheckFit(scene, {mesh.spans(), coarse.mesh, coarse.error_m}, gsd_m,
                                                              AllViewsSee(coverage), silent, warnings, fetch));
    AddFitFault(judged, anyway, &faults, warnings);
    *fit = FitTableToJson(MakeFitTable(scene, judged.fit, nullptr), kReportedImages);
    if (judged.has_reading) return faults.ToStatus();
  }
  AddVisibilityFaults(scene, coverage, &faults);
  return faults.ToStatus();
}

}  // namespace

StatusOr<TaskOutcome> RunInspect(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const InspectParameters parameters, ParseInspectParameters(request.parameters));
  SceneLoadOptions load;
  load.to_be_classified = parameters.classify;
  TESSERA_ASSIGN_OR_RETURN(const PartInspection found, InspectPart(InputPath(request, kSceneFolder), load, control));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(OutputPath(request, kInspectionFile), found.json));
  TaskOutcome outcome;
  outcome.outputs = {kInspectionFile};
  outcome.stats = nlohmann::json{{"faults", found.has_faults}, {"seconds", SecondsSince(clock, start_us)}}.dump();
  outcome.found_faults = found.has_faults;
  return outcome;
}

StatusOr<InspectedFiles> ReadInspections(const TaskRequest& request, const IngestParameters& parameters) {
  InspectedFiles files;
  files.fetch = request.fetch;
  for (int i = 0; i < parameters.inspections; ++i) {
    TESSERA_ASSIGN_OR_RETURN(const std::string json, ReadFile(InputPath(request, TileInputName(i, kInspectionFile))));
    TESSERA_RETURN_IF_ERROR(files.inspections.Add(json, InputPath(request, kSceneFolder)));
  }
  return files;
}

StatusOr<TaskOutcome> RunIngest(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const IngestParameters parameters, ParseIngestParameters(request.parameters));
  TESSERA_ASSIGN_OR_RETURN(const TempFolder scratch_folder, TempFolder::Create(request.output_dir, "scratch-"));
  const std::string& scratch = scratch_folder.path();
  TaskOutcome outcome;
  control.Report(0, "checking the scene");
  SceneLoadOptions load;
  load.to_be_classified = parameters.classify;
  load.by_default_rule = parameters.by_default_rule;
  load.skip_images = parameters.skip_images;
  load.anyway = parameters.anyway;
  TESSERA_ASSIGN_OR_RETURN(const InspectedFiles files, ReadInspections(request, parameters));
  // Reports all errors at once.
  TESSERA_ASSIGN_OR_RETURN(CheckedScene checked, CheckScene(InputPath(request, kSceneFolder), load, kMaxFacesInMemory,
                                                            &outcome.warnings, PartOf(control, 0, 0.3), files));
  SceneDescription& scene = checked.scene;
  const SceneSummary& summary = checked.summary;
  for (size_t v = 0; v < scene.views.size(); ++v) {
    SceneView& view = scene.views[v];
    view.camera = OnLocalGrid(view.camera);
    view.image_content = summary.contents[v].image;
    view.likelihood_content = summary.contents[v].likelihood;
    view.masked = summary.contents[v].masked_share > 0;
  }
  if (!summary.has_likelihoods && scene.has_likelihoods) IgnoreLikelihoods(&scene);
  const std::vector<PosedCamera> cameras = CamerasOf(scene);
  control.Report(0.3, "reading the mesh");
  Warnings of_large_mesh;  // a smaller one was checked with the scene
  TESSERA_ASSIGN_OR_RETURN(DiskMesh mesh, ReadMeshToDisk(scene, scratch, &of_large_mesh));
  Survey survey;
  survey.has_labels = mesh.labels.size() > 0;
  survey.input_vertices = static_cast<int64_t>(mesh.vertices.size());
  survey.input_faces = static_cast<int64_t>(mesh.faces.size());
  TESSERA_RETURN_IF_ERROR(control.Check());

  control.Report(0.4, "repairing the mesh");
  MeshDefects defects;
  RepairOptions repair = RepairOptionsOf(scene.views, scene.frame);
  repair.file_origin = OnLocalGrid(repair.file_origin);
  repair.scratch_folder = scratch;
  repair.file = absl::StrCat(scene.folder, "/", scene.mesh_path);
  TESSERA_ASSIGN_OR_RETURN(mesh, RepairOnDisk(std::move(mesh), scratch, DiskPassOptions(), repair, &defects));
  if (mesh.faces.size() == 0)
    return InputError(scene.mesh_path, "", "only degenerate faces", "at least one face with an area");
  TESSERA_ASSIGN_OR_RETURN(survey.gsd_m, MedianGsd(scene, GsdSamples(mesh.spans())));
  if (parameters.classify) {
    TESSERA_ASSIGN_OR_RETURN(survey.classifier,
                             ClassifierContent(request, parameters, survey.gsd_m, &outcome.warnings));
    TESSERA_RETURN_IF_ERROR(FillClassifiedContents(survey, {}, files, control, &scene));
  }
  if (survey.input_faces > kMaxFacesInMemory) {
    outcome.warnings.insert(outcome.warnings.end(), of_large_mesh.begin(), of_large_mesh.end());
    TESSERA_RETURN_IF_ERROR(CheckLargeMesh(scene, mesh, defects, survey.gsd_m, scratch, parameters.anyway, files.fetch,
                                           control, &outcome.warnings, &survey.fit));
  }
  TESSERA_RETURN_IF_ERROR(control.Check());

  DensityOptions density;
  if (parameters.coarse_faces) density.max_footprint_px2 = kCoarseFootprint_px2;
  TESSERA_ASSIGN_OR_RETURN(
      mesh, SplitOnDisk(std::move(mesh), cameras, density, scratch, DiskPassOptions(), [&](double fraction) {
        control.Report(0.5 + 0.1 * fraction, "splitting faces");
        return control.Check();
      }));
  TESSERA_RETURN_IF_ERROR(CompleteLabels(scene.has_likelihoods, scratch, &mesh));

  CellViewOptions view_options;
  view_options.choice.views_per_direction =
      parameters.views_per_direction.value_or(view_options.choice.views_per_direction);
  survey.scene_name = scene.name;
  survey.mesh_path = scene.mesh_path;
  survey.label_property = scene.label_property;
  survey.up = scene.up_in_local;
  survey.ground = MakeGroundPlane(survey.up, CellSide_m(survey.gsd_m));
  survey.views = scene.views;
  survey.flights = scene.flights;
  FillPairs(mesh.spans(), cameras, parameters, &survey);
  survey.classes = scene.classes;
  survey.has_likelihoods = scene.has_likelihoods;
  survey.borders = scene.has_likelihoods ? summary.borders : BorderTrusts(static_cast<int>(scene.classes.size()));
  survey.crs = scene.frame.crs();
  if (scene.source) survey.source = SceneSourceToJson(*scene.source);
  survey.origin_in_scene = scene.frame.origin_in_scene();
  survey.rotation_local_from_scene = scene.frame.rotation_local_from_scene();
  survey.vertices = static_cast<int64_t>(mesh.vertices.size());
  survey.faces = static_cast<int64_t>(mesh.faces.size());
  control.Report(0.6, "writing the city");
  survey.cells = CellsOf(mesh.spans(), survey.ground);
  if (parameters.coarse_faces) {
    // Halved edges of these faces are short enough.
    DensityOptions once;
    once.max_rounds = 1;
    CountSplitFaces(mesh.spans(), cameras, once, DiskPassOptions(), survey.ground, &survey.cells);
  }
  const std::string city_path = OutputPath(request, kCityFile);
  TESSERA_RETURN_IF_ERROR(
      WriteCity(city_path, {mesh.spans(), mesh.input_face.values()}, survey.ground, survey.cells, scratch));
  TESSERA_ASSIGN_OR_RETURN(const CityReader city, CityReader::Open(city_path));
  TESSERA_RETURN_IF_ERROR(ChooseViews(mesh.spans(), city, view_options, PartOf(control, 0.7, 0.98), scratch, &survey));
  FillViewDepths(&survey);
  if (summary.fit) survey.fit = FitTableToJson(summary.fit_table, kReportedImages);
  // The folder's path differs between workers.
  for (std::string& warning : outcome.warnings) warning = absl::StrReplaceAll(warning, {{scene.folder + "/", ""}});
  survey.warnings = outcome.warnings;
  for (const SkippedImage& image : scene.skipped) survey.skipped_images.emplace_back(image.name, image.reason);

  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(OutputPath(request, kSurveyFile), SurveyToJson(survey)));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(OutputPath(request, kPlainSurveyFile), SurveyToJson(WithoutNames(survey))));
  outcome.outputs = {kCityFile, kSurveyFile, kPlainSurveyFile};
  outcome.stats = nlohmann::json{{"views", survey.views.size()},
                                 {"pairs", survey.pairs.size()},
                                 {"cells", survey.cells.size()},
                                 {"input_faces", survey.input_faces},
                                 {"faces", survey.faces},
                                 {"gsd_m", survey.gsd_m},
                                 {"seconds", SecondsSince(clock, start_us)}}
                      .dump();
  return outcome;
}

}  // namespace tessera
