#include "server/admission/scene_reader.h"

#include <functional>
#include <utility>

#include "common/classify/default_rule.h"
#include "common/classify/model.h"
#include "common/scene/scene.h"
#include "common/scene/stored_scenes.h"
#include "server/settings/job_settings.h"

namespace tessera {
namespace {

// Content of a trained classifier that has the scene's classes; empty for the default classifier.
StatusOr<std::string> ReadClassifier(const std::string& classifier, const SceneDescription& scene,
                                     const AllowedFiles& allowed) {
  const std::vector<std::string> classes = ClassNames(scene);
  if (classifier == kDefaultClassifier) {
    TESSERA_RETURN_IF_ERROR(DefaultRule::Of(classes, scene.folder + "/scene.json").status());
    return std::string();
  }
  StatusOr<std::string> bytes = allowed.ReadWhole(classifier, kMaxModelBytes);
  const StatusOr<ClassifierModel> model =
      bytes.ok() ? ParseModel(*bytes, classifier) : StatusOr<ClassifierModel>(bytes.status());
  if (!model.ok() && !absl::IsNotFound(model.status())) {
    return absl::InvalidArgumentError(model.status().message());  // any fault of the file is the caller's error
  }
  TESSERA_RETURN_IF_ERROR(model.status());
  TESSERA_RETURN_IF_ERROR(ModelClassesOf(*model, classes, classifier).status());
  return bytes;
}

using Loader = std::function<StatusOr<SceneDescription>(Warnings* warnings, const SceneLoadOptions& options)>;

// The listing of a scene, without its folder and digests.
StatusOr<SceneListing> ListScene(const Loader& load_scene, const SceneRequest& request, const AllowedFiles& allowed) {
  SceneListing listing;
  SceneLoadOptions options;
  options.needs_mesh = request.needs_mesh;
  options.allowed = allowed;
  options.skip_images = request.skip_images;
  listing.classifier = request.classifier;
  if (listing.classifier == kNoClassifier) listing.classifier.clear();
  const auto load = [&]() -> StatusOr<SceneDescription> {
    options.to_be_classified = request.base_classifies || !listing.classifier.empty();
    options.by_default_rule = listing.classifier == kDefaultClassifier;
    listing.warnings.clear();
    TESSERA_ASSIGN_OR_RETURN(SceneDescription found, load_scene(&listing.warnings, options));
    if (!listing.classifier.empty()) {
      TESSERA_ASSIGN_OR_RETURN(listing.classifier_content, ReadClassifier(listing.classifier, found, allowed));
    }
    return found;
  };
  TESSERA_ASSIGN_OR_RETURN(SceneDescription scene, load());
  // A scene without likelihoods and labels gets the default classifier if that has its classes.
  if (request.classifier.empty() && request.needs_mesh && !scene.has_likelihoods && !scene.mesh_has_labels) {
    const SceneListing unclassified = listing;
    listing.classifier = kDefaultClassifier;
    StatusOr<SceneDescription> classified = load();
    if (classified.ok()) {
      scene = *std::move(classified);
    } else {
      listing = unclassified;
    }
  }
  listing.folder = AbsolutePath(scene.folder);
  listing.name = scene.name;
  listing.files = scene.files;
  listing.place.frame = scene.frame;
  listing.place.up = scene.up_in_local;
  listing.place.classes = scene.classes;
  listing.place.source = scene.source;
  listing.scene = std::move(scene);
  return listing;
}

}  // namespace

StatusOr<SceneListing> ReadScene(const std::string& path, const SceneRequest& request, const AllowedFiles& allowed) {
  return ListScene(
      [&](Warnings* warnings, const SceneLoadOptions& options) { return LoadScene(path, warnings, options); }, request,
      allowed);
}

StatusOr<SceneListing> ReadStoredScene(const std::string& url, const SceneRequest& request, const AllowedFiles& allowed,
                                       const StoredScenes& scenes, const std::function<bool()>& cancelled) {
  TESSERA_ASSIGN_OR_RETURN(const FetchedScene fetched, FetchScene(scenes, url, cancelled));
  StatusOr<SceneListing> listing = ListScene(
      [&](Warnings* warnings, const SceneLoadOptions& options) { return LoadFetchedScene(fetched, warnings, options); },
      request, allowed);
  if (!listing.ok()) return fetched.Named(listing.status());
  listing->folder = fetched.url;
  TESSERA_ASSIGN_OR_RETURN(listing->digests, DigestsOf(fetched.manifest, listing->files));
  return listing;
}

}  // namespace tessera
