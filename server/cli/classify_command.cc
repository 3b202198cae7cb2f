// `tessera classify`: computes class likelihoods of a scene's images from annotations, a trained model or a default
// rule.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <iostream>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/base/task_usage.h"
#include "common/classify/classified_scene_files.h"
#include "common/classify/classify_report.h"
#include "common/classify/classify_scene.h"
#include "common/classify/training.h"
#include "common/check/check.h"
#include "common/scene/repair_options.h"
#include "common/scene/scene.h"
#include "common/scene/scene_json.h"
#include "common/storage/files.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/client/interrupt.h"
#include "server/display/stage_line.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

constexpr double kCheckedShare = 0.1;  // of the progress

struct ClassifyArguments {
  std::string scene, out;
  std::string train, model, save_model;
  std::string mesh;  // replaces the scene's mesh
  uint64_t seed = 1;
  double skip_images = 0;
  bool anyway = false;
  int threads = 0;
  bool quiet = false;
};

std::string SceneFileOf(const std::string& path) {
  return fs::is_directory(path) ? (fs::path(path) / "scene.json").string() : path;
}

Status Classify(const ClassifyArguments& arguments, const TaskControl& control, std::string* text,
                Warnings* warnings) {
  const ThreadLimit limit(arguments.threads);
  TESSERA_RETURN_IF_ERROR(CheckClassifiedFolder(arguments.out));
  ClassifyReport report;
  SceneLoadOptions load;
  load.all_classes = true;
  load.skip_images = arguments.skip_images;
  load.anyway = arguments.anyway;
  StatusOr<CheckedScene> checked = CheckScene(arguments.scene, load, std::numeric_limits<int64_t>::max(),
                                              &report.warnings, PartOf(control, 0, kCheckedShare));
  *warnings = report.warnings;
  TESSERA_RETURN_IF_ERROR(checked.status());
  SceneDescription& scene = checked->scene;
  if (!arguments.mesh.empty()) {
    std::error_code error;
    scene.mesh_path = fs::relative(arguments.mesh, scene.folder, error).string();
    if (error) return InputError(arguments.mesh, "", error.message(), "a mesh in the scene's coordinates");
    scene.label_property.reset();  // it is that of the scene's mesh
  }
  Warnings repeated;
  Warnings* const of_mesh = arguments.mesh.empty() ? &repeated : &report.warnings;
  TESSERA_ASSIGN_OR_RETURN(const TriangleMesh loaded, LoadSceneMesh(scene, 0, of_mesh));
  TESSERA_ASSIGN_OR_RETURN(const RepairedMesh repaired,
                           RepairMesh(loaded, RepairOptionsOf(scene.views, scene.frame), of_mesh));
  const TriangleMesh& mesh = repaired.mesh;
  if (mesh.faces.empty()) return InputError(scene.mesh_path, "", "no faces", "at least one");
  TESSERA_ASSIGN_OR_RETURN(report.gsd_m, MedianGsd(scene, mesh));
  report.scene = &scene;

  // Check all input before the long computation.
  std::optional<Annotations> annotations;
  ClassifierModel model;
  std::optional<DefaultRule> rule;
  ClassifierSelection use;
  const std::vector<std::string> names = ClassNames(scene);
  if (!arguments.train.empty()) {
    report.source = "annotations";
    TESSERA_ASSIGN_OR_RETURN(annotations, ReadAnnotations(arguments.train, scene, &report.warnings));
  } else if (!arguments.model.empty()) {
    report.source = "model";
    TESSERA_ASSIGN_OR_RETURN(model, ReadModel(arguments.model));
    TESSERA_ASSIGN_OR_RETURN(use.class_of_scene, ModelClassesOf(model, names, arguments.model));
    use.model = &model;
    report.model_gsd_m = model.gsd_m;
    const std::string warning = GsdWarning(model, report.gsd_m, arguments.model);
    if (!warning.empty()) report.warnings.push_back(warning);
  } else {
    report.source = kDefaultLikelihoods;
    TESSERA_ASSIGN_OR_RETURN(rule, DefaultRule::Of(names, SceneFileOf(arguments.scene)));
    use.rule = &*rule;
  }

  control.Report(kCheckedShare, "reading the mesh");
  const MeshSurface surface(mesh, scene.up_in_local, report.gsd_m);
  std::optional<TrainedClassifier> trained;
  if (annotations) {
    const TaskUsageMeter meter;
    const TaskControl part = PartOf(control, kCheckedShare, 0.5);
    TrainingOptions options;
    options.seed = arguments.seed;
    TESSERA_ASSIGN_OR_RETURN(trained, TrainClassifier(scene, *annotations, surface, report.gsd_m, options, part));
    report.train_cpu_s = meter.Read().core_seconds;
    use.model = &trained->model;
    use.trained = report.trained = &*trained;
    use.annotations = report.annotations = &*annotations;
  }
  const TaskUsageMeter meter;
  const TaskControl part = PartOf(control, annotations ? 0.5 : kCheckedShare, 1);
  TESSERA_ASSIGN_OR_RETURN(const ClassifiedScene classified, ClassifyScene(scene, surface, use, arguments.out, part));
  report.classify_cpu_s = meter.Read().core_seconds;
  report.classified = &classified;
  TESSERA_RETURN_IF_ERROR(WriteClassifiedScene(scene, SceneFileOf(arguments.scene), arguments.out, report.source));
  if (!arguments.save_model.empty())
    TESSERA_RETURN_IF_ERROR(WriteOutput(arguments.save_model, SerializeModel(*use.model)));
  TESSERA_RETURN_IF_ERROR(WriteOutput((fs::path(arguments.out) / "report.json").string(), ClassifyJson(report)));
  *text = ClassifyText(report);
  *warnings = report.warnings;
  return absl::OkStatus();
}

}  // namespace

void AddClassifyCommand(CLI::App& app, int* exit_code) {
  auto arguments = std::make_shared<ClassifyArguments>();
  CLI::App* command =
      app.add_subcommand("classify", "Compute class likelihoods of a scene's images from a few annotated images");
  command->add_option("SCENE", arguments->scene, "Folder with a scene.json, or the scene.json itself")->required();
  command->add_option("--out", arguments->out, "Folder to write, new or of an earlier classification")->required();
  CLI::Option* train = command->add_option("--train", arguments->train, "Folder of annotated images")->type_name("DIR");
  command->add_option("--model", arguments->model, "Model that --save-model wrote, of another flight or city")
      ->excludes(train);
  command->add_option("--save-model", arguments->save_model, "Also write the trained model to this file")->needs(train);
  command->add_option("--mesh", arguments->mesh,
                      "Mesh to use instead of the scene's, such as a refined one for better features; OUT uses it too");
  AddSceneOptions(*command, &arguments->skip_images, &arguments->anyway);
  command->add_option("--seed", arguments->seed, "Seed of the sampled training pixels")->capture_default_str();
  command
      ->add_option("--threads", arguments->threads,
                   "Number of threads; 0: one per core. The result does not depend on it")
      ->check(CLI::NonNegativeNumber);
  command->add_flag("--quiet", arguments->quiet, "Print neither progress nor the summary table");
  command->footer(
      "DIR of --train holds PNG files named and sized as the images (0007.png for 0007.jpg): class numbers in one\n"
      "channel, 255 for unlabelled pixels; or the classes' colours, with unlabelled pixels white, black or\n"
      "transparent. A few strokes per class in four images are enough. Annotate some objects up to their boundary,\n"
      "so that the classifier learns boundaries.\n"
      "OUT is a scene of its own, with links to the images. OUT/geometry: likelihoods from colour, texture and\n"
      "the start mesh, which jobs read. OUT/appearance: from colour and texture only, for comparison. "
      "OUT/report.json:\n"
      "results of spatial cross-validation, and the image to annotate next.\n"
      "Examples:\n"
      "  tessera classify city --train painted --out classified --save-model city.model\n"
      "  tessera run classified --out out\n"
      "  tessera classify city --train painted --mesh out/mesh.ply --out again     with the refined mesh,\n"
      "  tessera run again --method labels --out labelled                          then labels only\n"
      "  tessera classify next-city --model city.model --out classified-next\n"
      "  tessera classify bare --out guessed          default rule, from the mesh and greenness");
  command->callback([arguments, exit_code] {
    InstallInterruptCounter();
    Status status;
    std::string text;
    Warnings warnings;
    {
      StageLine line(!arguments->quiet);
      TaskControl control;
      control.report = [&](double fraction, const std::string& stage) { line.Show(fraction, stage); };
      control.cancelled = [] { return Interrupts() > 0; };
      status = Classify(*arguments, control, &text, &warnings);
    }
    if (status.ok()) {
      PrintWarnings(warnings);
      if (!arguments->quiet) std::cout << text << std::flush;
      return;
    }
    *exit_code = ReportError("classify", status);
    PrintWarnings(warnings);
    if (absl::IsAlreadyExists(status)) *exit_code = kExitUsage;
    if (absl::IsFailedPrecondition(status) || absl::IsDataLoss(status)) *exit_code = kExitBadInput;
  });
}

}  // namespace tessera
