#include "worker/tasks/classified_views.h"

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/classify/model.h"
#include "common/imaging/image_io.h"
#include "common/storage/files.h"
#include "common/storage/hash.h"
#include "worker/tasks/task_functions.h"

namespace tessera {

StatusOr<std::string> ClassifierContent(const TaskRequest& request, const IngestParameters& parameters, double gsd_m,
                                        Warnings* warnings) {
  if (parameters.by_default_rule) return std::string("default");
  const std::string path = InputPath(request, absl::StrCat(kSceneFolder, "/", kClassifierFile));
  TESSERA_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path));
  TESSERA_ASSIGN_OR_RETURN(const ClassifierModel model, ParseModel(bytes, "the classifier"));
  const std::string warning = GsdWarning(model, gsd_m, "the classifier");
  if (!warning.empty()) warnings->push_back(warning);
  return Xxh3Hex(bytes.data(), bytes.size());
}

Status FillClassifiedContents(const Survey& survey, const std::set<std::string>& known, const InspectedFiles& files,
                              const TaskControl& control, SceneDescription* scene) {
  std::vector<SceneView*> to_read;
  std::vector<std::string> paths;
  for (SceneView& view : scene->views) {
    if (known.contains(view.image_path)) continue;
    if (const std::string rgb = files.inspections.RgbOf(view); !rgb.empty()) {
      view.likelihood_content = ClassifiedContent(survey, rgb);
      continue;
    }
    to_read.push_back(&view);
    paths.push_back(view.image_path);
  }
  TESSERA_RETURN_IF_ERROR(FetchInScene(scene->folder, paths, files.fetch));
  std::vector<Status> statuses(to_read.size());
  ParallelForEach(to_read.size(), 1, [&](int64_t i) {
    SceneView& view = *to_read[i];
    if (!control.Check().ok()) return;
    const auto rgb = ReadRgb(absl::StrCat(scene->folder, "/", view.image_path), view.white_level);
    statuses[i] = rgb.status();
    if (rgb.ok()) view.likelihood_content = ClassifiedContent(survey, Xxh3Hex(rgb->data.data(), rgb->data.size()));
  });
  Faults faults;
  for (const Status& status : statuses) faults.Add(status);
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  return control.Check();
}

}  // namespace tessera
