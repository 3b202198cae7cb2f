// What the views of a scene have in common: names of their files, classes, forms of likelihoods.
#include <filesystem>
#include <map>
#include <set>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/scene/scene.h"

namespace tessera {
namespace {

std::string StemOfView(const SceneView& view) {
  return std::filesystem::path(view.name).replace_extension().generic_string();
}

}  // namespace

SceneClass OneClass() {
  SceneClass surface;
  surface.name = "surface";
  return surface;
}

std::vector<std::string> ClassNames(const SceneDescription& scene) {
  std::vector<std::string> names;
  for (const SceneClass& c : scene.classes) names.push_back(c.name);
  return names;
}

void FindLikelihoodForms(SceneDescription* scene, Warnings* warnings,
                         const std::map<std::string, LikelihoodForm>& known,
                         const std::map<std::string, LabelContent>& contents) {
  std::vector<std::string> names, paths;
  LikelihoodForm given;
  for (const SceneView& view : scene->views) {
    if (view.likelihood_path.empty() || known.contains(view.likelihood_path)) continue;
    names.push_back(view.likelihood_path);
    paths.push_back(absl::StrCat(scene->folder, "/", view.likelihood_path));
    given = view.likelihood_form;
  }
  for (const auto& [path, form] : known) {
    if (given == LikelihoodForm()) given = form;
  }
  std::vector<std::array<uint8_t, 3>> colors;
  for (const SceneClass& c : scene->classes) colors.push_back(c.color_rgb);
  std::vector<LabelContent> of_paths(paths.size());
  ParallelForEach(paths.size(), 1, [&](size_t i) {
    const auto content = contents.find(names[i]);
    of_paths[i] = content != contents.end() ? content->second : ReadLabelContent(paths[i], colors);
  });
  const LikelihoodForm form = CompleteLikelihoodForm(paths, of_paths, colors, given, warnings);
  for (SceneView& view : scene->views) {
    const auto found = known.find(view.likelihood_path);
    if (!view.likelihood_path.empty()) view.likelihood_form = found == known.end() ? form : found->second;
  }
}

std::vector<std::string> ViewStems(const SceneDescription& scene) {
  std::map<std::string, std::set<std::string>> images;
  for (const SceneView& view : scene.views) images[StemOfView(view)].insert(view.name);
  std::vector<std::string> stems;
  for (const SceneView& view : scene.views) {
    const std::string stem = StemOfView(view);
    stems.push_back(images[stem].size() > 1 ? view.name : stem);
  }
  return stems;
}

}  // namespace tessera
