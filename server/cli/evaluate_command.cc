// `tessera evaluate`: measures a mesh or likelihoods against the scene's truth.
#include <CLI/CLI.hpp>
#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/parallel.h"
#include "common/evaluate/evaluation_report.h"
#include "common/evaluate/evaluator.h"
#include "common/evaluate/label_rendering.h"
#include "common/evaluate/likelihood_scores.h"
#include "common/geometry/ray_caster.h"
#include "common/imaging/image_io.h"
#include "common/meshio/mesh_format.h"
#include "common/scene/scene.h"
#include "common/storage/files.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

constexpr double kRimInGsd = 30;  // default of --rim

struct EvaluateArguments {
  std::string mesh;
  std::string scene;
  std::string truth;  // folder; empty: SCENE/truth
  std::string json;
  std::optional<double> rim_m;
  std::string likelihoods;                // folder; measured instead of a mesh, or together with its labels
  std::vector<std::string> except_views;  // names, with or without extension
  bool no_start = false;
  int threads = 0;
  EvaluationOptions options;
};

StatusOr<TriangleMesh> ReadMeshInLocalFrame(const std::string& path, const SceneDescription& scene) {
  Warnings warnings;
  TESSERA_ASSIGN_OR_RETURN(MeshContent content, ReadMesh(path, {LabelPropertyOf(scene, path), &warnings, path}));
  PrintWarnings(warnings);
  for (Eigen::Vector3d& v : content.mesh.vertices) v = scene.frame.LocalFromScene(v);
  return std::move(content.mesh);
}

// Checks the mesh here because the evaluator's own errors do not name the file.
Status CheckMesh(const TriangleMesh& mesh, const std::string& path, size_t classes) {
  if (mesh.faces.empty()) return InputError(path, "", "no faces", "at least one");
  for (size_t f = 0; f < mesh.labels.size(); ++f) {
    if (mesh.labels[f] < -1 || mesh.labels[f] >= static_cast<int64_t>(classes)) {
      return InputError(path, "faces[" + std::to_string(f) + "]", "label " + std::to_string(mesh.labels[f]),
                        "one of the scene's " + std::to_string(classes) + " classes from 0, or -1 for none");
    }
  }
  return absl::OkStatus();
}

std::string TruthImagePath(const std::string& truth_folder, const SceneView& view) {
  const fs::path name(view.name);
  return (fs::path(truth_folder) / name.parent_path() / (name.stem().string() + "_label.png")).string();
}

// For each view, whether --except-views names it. INVALID_ARGUMENT if a name is no view of the scene.
StatusOr<std::vector<bool>> LeftOut(const std::vector<std::string>& names, const SceneDescription& scene) {
  std::vector<bool> left_out(scene.views.size());
  for (const std::string& name : names) {
    bool found = false;
    for (size_t v = 0; v < scene.views.size(); ++v) {
      const std::string& view = scene.views[v].name;
      if (name != view && name != fs::path(view).replace_extension().string()) continue;
      found = left_out[v] = true;
    }
    if (!found) return InputError("--except-views", "", name, "names of images of the scene");
  }
  return left_out;
}

// Path of the likelihoods of a view, of any supported format. `stem`: of the view (ViewStems).
StatusOr<std::string> LikelihoodPath(const std::string& folder, const std::string& stem, const SceneView& view) {
  const std::string path = (fs::path(folder) / stem).string();
  for (const char* extension : {".tif", ".tiff", ".npy", ".png"}) {
    if (fs::exists(path + extension)) return path + extension;
  }
  return InputError(path, "", "no .tif, .tiff, .npy or .png", "the likelihoods of image '" + view.name + "'");
}

// The form of the likelihoods in the folder.
LikelihoodForm FormOf(const std::string& folder, const std::vector<std::string>& stems, const SceneDescription& scene) {
  SceneDescription in_folder = scene;
  in_folder.folder = folder;
  for (size_t v = 0; v < scene.views.size(); ++v) {
    const StatusOr<std::string> path = LikelihoodPath(folder, stems[v], scene.views[v]);
    in_folder.views[v].likelihood_path = path.ok() ? fs::relative(*path, folder).string() : "";
  }
  Warnings warnings;
  FindLikelihoodForms(&in_folder, &warnings);
  PrintWarnings(warnings);
  const auto read = std::find_if(in_folder.views.begin(), in_folder.views.end(),
                                 [](const SceneView& view) { return !view.likelihood_path.empty(); });
  return read == in_folder.views.end() ? LikelihoodForm() : read->likelihood_form;
}

// Renders a mesh's labels in the views, only at pixels where the start mesh has a surface too.
class MeshInViews {
 public:
  // Pixels of faces without a label count as errors.
  static StatusOr<MeshInViews> Of(TriangleMesh mesh, const std::string& path, const SceneDescription& scene) {
    if (mesh.labels.empty()) return InputError(path, "", "no labels", "labels to compare with the likelihoods");
    for (int32_t& label : mesh.labels) label = label < 0 ? static_cast<int32_t>(scene.classes.size()) : label;
    TESSERA_ASSIGN_OR_RETURN(const TriangleMesh start, LoadSceneMesh(scene, 0));
    return MeshInViews(std::move(mesh), start, scene);
  }

  LabelImage Rendered(size_t view) const {
    const SceneView& of = scene_->views[view];
    const PosedCamera& camera = of.camera;
    LabelImage labels = RenderLabels(mesh_, caster_, camera);
    const Eigen::Vector3d centre = camera.Centre();
    for (int y = 0; y < labels.height; ++y) {
      for (int x = 0; x < labels.width; ++x) {
        if (!start_.Cast(centre, camera.Ray(x + 0.5, y + 0.5)).hit()) labels.at(x, y) = 255;
      }
    }
    return labels;
  }

 private:
  MeshInViews(TriangleMesh mesh, const TriangleMesh& start, const SceneDescription& scene)
      : scene_(&scene), mesh_(std::move(mesh)), caster_(mesh_), start_(start) {}

  const SceneDescription* scene_;
  TriangleMesh mesh_;
  RayCaster caster_, start_;
};

Status EvaluateLikelihoods(const EvaluateArguments& arguments, const SceneDescription& scene,
                           const TruthLabelSource& truth_labels) {
  const int classes = static_cast<int>(scene.classes.size());
  const std::vector<std::string> stems = ViewStems(scene);
  const LikelihoodForm form = FormOf(arguments.likelihoods, stems, scene);
  const LikelihoodSource likelihoods = [&](size_t view) -> StatusOr<FloatImage> {
    TESSERA_ASSIGN_OR_RETURN(const std::string path,
                             LikelihoodPath(arguments.likelihoods, stems[view], scene.views[view]));
    return ReadLikelihoods(path, classes, scene.views[view].lens, form);
  };
  std::optional<MeshInViews> mesh_in_views;
  LabelRendering rendering;
  if (!arguments.mesh.empty()) {
    TESSERA_ASSIGN_OR_RETURN(TriangleMesh mesh, ReadMeshInLocalFrame(arguments.mesh, scene));
    TESSERA_RETURN_IF_ERROR(CheckMesh(mesh, arguments.mesh, scene.classes.size()));
    TESSERA_ASSIGN_OR_RETURN(mesh_in_views, MeshInViews::Of(std::move(mesh), arguments.mesh, scene));
    rendering = [&](size_t view) { return mesh_in_views->Rendered(view); };
  }
  TESSERA_ASSIGN_OR_RETURN(const std::vector<LikelihoodConfusion> confusions,
                           ConfuseLikelihoods(scene.views, classes, truth_labels, likelihoods, rendering));
  if (confusions.empty()) {
    return InputError(arguments.truth, "", "no IMAGE_label.png of any evaluated view",
                      "true labels of at least one image");
  }
  std::cout << LikelihoodTable(confusions, ClassNames(scene)) << std::flush;
  if (arguments.json.empty()) return absl::OkStatus();
  return WriteOutput(arguments.json, LikelihoodJson(confusions, ClassNames(scene)));
}

Status Evaluate(EvaluateArguments arguments) {
  const ThreadLimit limit(arguments.threads);
  Warnings warnings;
  SceneLoadOptions load;
  load.skip_images = kMaxSkippedShare;  // a job may have left images out, and no photograph is read
  TESSERA_ASSIGN_OR_RETURN(const SceneDescription scene, LoadScene(arguments.scene, &warnings, load));
  PrintWarnings(warnings);
  if (arguments.truth.empty()) arguments.truth = (fs::path(scene.folder) / "truth").string();
  TESSERA_ASSIGN_OR_RETURN(const std::vector<bool> left_out, LeftOut(arguments.except_views, scene));
  const TruthLabelSource truth_labels = [&](size_t view) -> StatusOr<LabelImage> {
    const std::string path = TruthImagePath(arguments.truth, scene.views[view]);
    if (left_out[view] || !fs::exists(path)) return LabelImage();
    return ReadLabelImage(path);
  };
  if (!arguments.likelihoods.empty()) return EvaluateLikelihoods(arguments, scene, truth_labels);
  if (arguments.mesh.empty()) return InputError("evaluate", "", "no mesh", "a mesh, or --likelihoods DIR");
  const std::string truth_path = (fs::path(arguments.truth) / "mesh.ply").string();
  if (!fs::exists(truth_path)) {
    return InputError(truth_path, "", "no such file", "the true mesh; if it lies elsewhere, pass --truth DIR");
  }
  TESSERA_ASSIGN_OR_RETURN(const TriangleMesh mesh, ReadMeshInLocalFrame(arguments.mesh, scene));
  TESSERA_RETURN_IF_ERROR(CheckMesh(mesh, arguments.mesh, scene.classes.size()));
  TESSERA_ASSIGN_OR_RETURN(TriangleMesh truth, ReadMeshInLocalFrame(truth_path, scene));
  TESSERA_RETURN_IF_ERROR(CheckMesh(truth, truth_path, scene.classes.size()));

  EvaluationOptions& options = arguments.options;
  options.up_in_local = scene.up_in_local;
  if (arguments.rim_m) {
    options.rim_m = *arguments.rim_m;
  } else {
    TESSERA_ASSIGN_OR_RETURN(const double gsd_m, MedianGsd(scene, truth));
    options.rim_m = 0.01 * std::round(100 * kRimInGsd * gsd_m);
  }

  size_t truth_images = 0;
  for (const SceneView& view : scene.views) truth_images += fs::exists(TruthImagePath(arguments.truth, view));
  if (mesh.labels.empty()) {
    std::cerr << "note: " << arguments.mesh << " has no labels: only geometry is measured\n";
  } else if (truth_images == 0) {
    std::cerr << "note: " << arguments.truth << " has no IMAGE_label.png: labels are not measured by rendered pixels\n";
  } else if (truth_images < scene.views.size()) {
    std::cerr << "note: " << truth_images << " of " << scene.views.size() << " views have a truth image\n";
  }
  TESSERA_ASSIGN_OR_RETURN(
      const Evaluator evaluator,
      Evaluator::Create(std::move(truth), scene.views, static_cast<int>(scene.classes.size()), truth_labels, options));
  std::vector<NamedEvaluation> evaluations;
  if (!arguments.no_start) {
    TESSERA_ASSIGN_OR_RETURN(const TriangleMesh start, LoadSceneMesh(scene, 0));
    TESSERA_ASSIGN_OR_RETURN(Evaluation evaluation, evaluator.Evaluate(start));
    evaluations.push_back({"start", std::move(evaluation)});
  }
  TESSERA_ASSIGN_OR_RETURN(Evaluation evaluation, evaluator.Evaluate(mesh));
  evaluations.push_back({"result", std::move(evaluation)});
  std::cout << EvaluationTable(evaluations, ClassNames(scene), options) << std::flush;
  if (arguments.json.empty()) return absl::OkStatus();
  return WriteOutput(arguments.json, EvaluationJson(evaluations, ClassNames(scene), options));
}

}  // namespace

void AddEvaluateCommand(CLI::App& app, int* exit_code) {
  auto arguments = std::make_shared<EvaluateArguments>();
  CLI::App* command = app.add_subcommand("evaluate", "Measure a mesh against the scene's truth");
  command->footer(
      "Measures geometry and labels, and prints them beside the figures of the start mesh. Points are sampled by area\n"
      "on the mesh (accuracy) and on the truth (completeness). A point counts if enough cameras see it, by ray tests "
      "on\n"
      "its own surface; its error is the exact distance to the other surface. Labels are measured by area and by\n"
      "rendered pixels.\n"
      "Examples:\n"
      "  tessera evaluate out/mesh.ply --scene city\n"
      "  tessera evaluate peer.ply --scene campus --rim 3 --json peer.json\n"
      "  tessera evaluate --likelihoods classified/geometry --scene city --except-views 0000,0007\n"
      "  tessera evaluate out/mesh.ply --likelihoods classified/geometry --scene city");
  EvaluationOptions& options = arguments->options;
  command->add_option("mesh", arguments->mesh, "Mesh to measure, PLY or OBJ in the scene's coordinates");
  command->add_option("--scene", arguments->scene, "Folder with a scene.json, or the scene.json itself")->required();
  command->add_option("--truth", arguments->truth,
                      "Folder of mesh.ply and IMAGE_label.png, in the scene's coordinates (default SCENE/truth)");
  command->add_option(
      "--likelihoods", arguments->likelihoods,
      "Folder of likelihoods to score by their most likely class per pixel; with a mesh, both are scored on the pixels "
      "that the mesh and the start mesh cover");
  command
      ->add_option("--except-views", arguments->except_views,
                   "Images to leave out of the label figures, such as annotated ones: 0000,0007")
      ->delimiter(',');
  command
      ->add_option("--rim", arguments->rim_m,
                   "Width of the ignored rim inside the truth's horizontal box, metres (default 30 GSD)")
      ->check(CLI::NonNegativeNumber);
  command->add_option("--cap", options.cap_m, "Cap of distances in capped means, metres")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_option("--f-distances", options.f_distances_m, "Distances at which the F-score is computed, metres")
      ->check(CLI::PositiveNumber)
      ->delimiter(',')
      ->capture_default_str();
  command->add_option("--min-views", options.min_views, "Smallest number of cameras that see a point for it to count")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command->add_option("--samples", options.samples, "Number of points sampled on each surface")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_option("--seed", options.seed, "Seed of the sampled points")->capture_default_str();
  command
      ->add_option("--boundary-px", options.boundary_reach_px, "Distance within which class boundaries match, pixels")
      ->check(CLI::Range(0, 50))
      ->capture_default_str();
  command->add_option("--json", arguments->json, "Also write all figures to this file, as JSON");
  command->add_flag("--no-start", arguments->no_start, "Do not measure the start mesh");
  command
      ->add_option("--threads", arguments->threads,
                   "Number of threads; 0: one per core. The figures do not depend on it")
      ->check(CLI::NonNegativeNumber);
  command->callback([arguments, exit_code] {
    const Status status = Evaluate(*arguments);
    if (status.ok()) return;
    const int code = ReportError("evaluate", status);
    *exit_code = absl::IsFailedPrecondition(status) ? kExitBadInput : code;
  });
}

}  // namespace tessera
