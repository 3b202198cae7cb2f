#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "absl/strings/str_cat.h"
#include "common/base/json_bounds.h"
#include "common/classify/classify_scene.h"
#include "common/imaging/image_io.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "common/scene/photographs.h"
#include "common/storage/files.h"
#include "worker/city/city_file.h"
#include "worker/city/view_box.h"
#include "worker/tasks/task_functions.h"

namespace tessera {
namespace {

// Radius of the surface that a point's features depend on.
constexpr double kReach_m = 30;
static_assert(kReach_m >= MeshSurface::kGroundRadii_m.back() && kReach_m >= MeshSurface::kReliefRadii_m.back());

// The blocks of the city that the view may show up to this depth, with the radius above. Empty if it shows no part of
// the city.
StatusOr<TriangleMesh> VisibleMesh(const CityReader& city, const PosedCamera& camera, double depth_m) {
  const Eigen::Vector3d reach = Eigen::Vector3d::Constant(kReach_m);
  TriangleMesh mesh;
  for (size_t b = 0; b < city.block_count(); ++b) {
    const Eigen::AlignedBox3d box(city.box(b).min() - reach, city.box(b).max() + reach);
    if (!MayShow(camera, box)) continue;
    double nearest_m = depth_m;
    for (int k = 0; k < 8; ++k) {
      const Eigen::Vector3d corner = box.corner(static_cast<Eigen::AlignedBox3d::CornerType>(k));
      nearest_m = std::min(nearest_m, camera.Project(corner).z());
    }
    if (nearest_m >= depth_m) continue;
    TESSERA_ASSIGN_OR_RETURN(const CityBlock block, city.Block(b));
    const uint32_t first = static_cast<uint32_t>(mesh.vertices.size());
    mesh.vertices.insert(mesh.vertices.end(), block.mesh.vertices.begin(), block.mesh.vertices.end());
    for (const Triangle& face : block.mesh.faces) {
      mesh.faces.push_back({first + face[0], first + face[1], first + face[2]});
    }
  }
  return mesh;
}

// The inputs for one view: its image, its pose, and the classes.
StatusOr<SceneDescription> SceneOf(const ClassifyParameters& parameters, const std::string& input_dir) {
  TESSERA_ASSIGN_OR_RETURN(std::vector<SceneView> views, ParseViews(parameters.view_json));
  SceneDescription scene;
  TESSERA_ASSIGN_OR_RETURN(scene.classes, ParseClasses(parameters.classes_json));
  if (views.size() != 1 || scene.classes.size() < 2 || parameters.up.size() != 3 || !(parameters.gsd_m > 0)) {
    return absl::InvalidArgumentError(absl::StrCat(
        "classify: found ", views.size(), " views, ", scene.classes.size(), " classes, ", parameters.up.size(),
        " coordinates of up and a GSD of ", parameters.gsd_m, ", expected 1, 2 or more, 3 and a length"));
  }
  scene.folder = input_dir;
  scene.up_in_local = Eigen::Map<const Eigen::Vector3d>(parameters.up.data());
  scene.views = std::move(views);
  scene.views[0].image_path = ViewFileName(parameters.view, false);
  if (!scene.views[0].mask_path.empty()) scene.views[0].mask_path = ViewMaskName(parameters.view);
  return scene;
}

}  // namespace

StatusOr<TaskOutcome> RunClassify(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const ClassifyParameters parameters, ParseClassifyParameters(request.parameters));
  TESSERA_ASSIGN_OR_RETURN(SceneDescription scene, SceneOf(parameters, request.input_dir));
  std::vector<std::string> names;
  for (const SceneClass& c : scene.classes) names.push_back(c.name);
  ClassifierSelection use;
  ClassifierModel model;
  std::optional<DefaultRule> rule;
  if (parameters.by_default_rule) {
    TESSERA_ASSIGN_OR_RETURN(rule, DefaultRule::Of(names, "scene.json"));
    use.rule = &*rule;
  } else {
    TESSERA_ASSIGN_OR_RETURN(model, ReadModel(InputPath(request, absl::StrCat(kSceneFolder, "/", kClassifierFile))));
    TESSERA_ASSIGN_OR_RETURN(use.class_of_scene, ModelClassesOf(model, names, "the classifier"));
    use.model = &model;
  }
  control.Report(0, "reading the city");
  TESSERA_ASSIGN_OR_RETURN(const CityReader city, CityReader::Open(InputPath(request, kCityFile)));
  SceneView& view = scene.views[0];
  TESSERA_ASSIGN_OR_RETURN(const TriangleMesh mesh, VisibleMesh(city, view.camera, parameters.depth_m));
  TESSERA_RETURN_IF_ERROR(control.Check());
  // A partner view may show nothing of the city where its mesh was revised.
  std::optional<MeshSurface> surface;
  if (!mesh.faces.empty()) surface.emplace(mesh, scene.up_in_local, parameters.gsd_m);
  TESSERA_RETURN_IF_ERROR(control.Check());
  control.Report(0.2, "classifying");
  TESSERA_ASSIGN_OR_RETURN(const ByteImage likelihoods, ClassifyView(scene, 0, surface ? &*surface : nullptr, use));
  TESSERA_RETURN_IF_ERROR(control.Check());
  control.Report(0.9, "measuring class borders");
  const std::string file = ViewFileName(parameters.view, true), borders_file = ViewBordersName(parameters.view);
  TESSERA_RETURN_IF_ERROR(EnsureFolder(std::filesystem::path(OutputPath(request, file)).parent_path().string()));
  TESSERA_RETURN_IF_ERROR(WriteLikelihoodTiff(OutputPath(request, file), likelihoods));
  // As ingest does for a scene with likelihoods.
  const int classes = static_cast<int>(names.size());
  BorderCounts borders(classes);
  TESSERA_ASSIGN_OR_RETURN(const FloatImage luminance, ReadLuminance(InputPath(request, view.image_path), view.lens,
                                                                   OptionsOf(request.input_dir, view)));
  TESSERA_ASSIGN_OR_RETURN(const FloatImage read, ReadLikelihoods(OutputPath(request, file), classes, view.lens));
  borders.Add(luminance, read);
  TESSERA_RETURN_IF_ERROR(
      WriteFileAtomic(OutputPath(request, borders_file), nlohmann::json(borders.ToCounts()).dump()));
  TaskOutcome outcome;
  outcome.outputs = {file, borders_file};
  outcome.stats = nlohmann::json{{"pixels", likelihoods.plane_size()},
                                 {"faces", mesh.faces.size()},
                                 {"seconds", SecondsSince(clock, start_us)}}
                      .dump();
  return outcome;
}

StatusOr<TaskOutcome> RunBorders(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const BordersParameters parameters, ParseBordersParameters(request.parameters));
  if (parameters.classes < 2)
    return absl::InvalidArgumentError(
        absl::StrCat("borders: found ", parameters.classes, " classes, expected at least 2"));
  BorderCounts borders(parameters.classes);
  for (const int32_t view : parameters.views) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    const std::string name = ViewBordersName(view);
    TESSERA_ASSIGN_OR_RETURN(const std::string text, ReadFile(InputPath(request, name)));
    TESSERA_RETURN_IF_ERROR(CheckJsonDepth(name, text));
    std::vector<int64_t> counts;
    try {
      nlohmann::json::parse(text).get_to(counts);
    } catch (const nlohmann::json::exception& e) {
      return absl::DataLossError(absl::StrCat(name, ": ", e.what()));
    }
    TESSERA_ASSIGN_OR_RETURN(const BorderCounts of_view, BorderCounts::FromCounts(parameters.classes, counts));
    borders.Add(of_view);
  }
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(OutputPath(request, kBordersFile), BordersToJson(borders.Trusts())));
  TaskOutcome outcome;
  outcome.outputs = {kBordersFile};
  outcome.stats = nlohmann::json{{"views", parameters.views.size()}, {"seconds", SecondsSince(clock, start_us)}}.dump();
  return outcome;
}

}  // namespace tessera
