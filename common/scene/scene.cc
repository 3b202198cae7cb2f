#include "common/scene/scene.h"

#include <fnmatch.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <set>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "common/base/parallel.h"
#include "common/colmap/colmap.h"
#include "common/imaging/image_io.h"
#include "common/meshio/mesh_format.h"
#include "common/scene/image_files.h"
#include "common/scene/photographs.h"
#include "common/scene/scene_json.h"
#include "common/scene/skip_images.h"
#include "common/storage/files.h"
#include "common/storage/lfs_pointer.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

std::string WithoutExtension(const std::string& name) { return fs::path(name).replace_extension().generic_string(); }

// Replaces the file's internal path by the path that the user knows in a library's message.
Status Named(const Status& status, const AllowedFile& file, const std::string& path) {
  if (status.ok() || file.path() == path) return status;
  return Status(status.code(), absl::StrReplaceAll(status.message(), {{file.path(), path}}));
}

class SceneLoader {
 public:
  SceneLoader(std::string folder, const SceneLoadOptions& options, Warnings* warnings, Faults* faults)
      : options_(options), warnings_(warnings), faults_(*faults) {
    scene_.folder = std::move(folder);
  }

  SceneDescription Load(const std::string& file) {
    StatusOr<std::string> text = options_.allowed.ReadWhole(file, 64 << 20);
    if (!text.ok()) {
      faults_.Add(absl::IsNotFound(text.status()) ? InputError(file, "", "no such file", "a scene.json file")
                                                  : text.status());
      return std::move(scene_);
    }
    json_ = ParseSceneFile(*text, file, &faults_);
    scene_.name = json_.name.empty() ? fs::path(scene_.folder).filename().string() : json_.name;
    scene_.up_in_local = Eigen::Vector3d::UnitZ();
    scene_.source = json_.source;
    scene_.label_property = json_.label_property;
    scene_.files.push_back(fs::path(file).filename().string());
    LoadCameras();
    FindImages();
    FindMasks();
    FindLikelihoods();
    FindMesh();
    ChooseClasses();
    AssignFlights();
    SetUp();
    std::sort(scene_.files.begin(), scene_.files.end());
    // Ids differ between programs. The order of the views decides how sums round, hence the last digits of a result.
    std::stable_sort(scene_.views.begin(), scene_.views.end(),
                     [](const SceneView& a, const SceneView& b) { return a.name < b.name; });
    return std::move(scene_);
  }

 private:
  std::string Full(const std::string& relative) const { return absl::StrCat(scene_.folder, "/", relative); }
  // Whether `path` is a folder. False with a fault if the path leaves the allowed folders.
  bool IsFolder(const std::string& path) {
    const StatusOr<bool> is_folder = options_.allowed.IsFolder(path);
    faults_.Add(is_folder.status());
    return is_folder.value_or(false);
  }
  void Warn(const std::string& text) {
    if (warnings_ != nullptr) warnings_->push_back(text);
  }

  void LoadCameras() {
    if (!IsFolder(Full(json_.cameras.path))) {
      faults_.Add(InputError(Full(json_.cameras.path), "", "no such folder", "the COLMAP model of the cameras"));
      return;
    }
    scene_.cameras_folder = json_.cameras.path;
    const size_t faults_before = faults_.messages().size();
    Warnings of_model;
    const CalibratedImages model =
        ReadColmapModel(Full(json_.cameras.path), CalibrationContent::kCameras, &faults_, options_.allowed, &of_model);
    for (const std::string& warning : of_model) Warn(absl::StrReplaceAll(warning, {{scene_.folder + "/", ""}}));
    for (const std::string& file : model.files) {
      scene_.files.push_back(absl::StrCat(json_.cameras.path, "/", file));
    }
    if (model.images.empty()) {
      if (faults_.empty()) faults_.Add(InputError(Full(json_.cameras.path), "", "no images", "at least one image"));
      return;
    }
    std::vector<double> centres[3];
    for (const CalibratedImage& image : model.images) {
      const Eigen::Vector3d c = -image.rotation_cam_from_world.transpose() * image.translation_cam_from_world;
      for (int k = 0; k < 3; ++k) centres[k].push_back(c[k]);
    }
    Eigen::Vector3d median;
    for (int k = 0; k < 3; ++k) {
      std::nth_element(centres[k].begin(), centres[k].begin() + centres[k].size() / 2, centres[k].end());
      median[k] = centres[k][centres[k].size() / 2];
    }
    if (options_.frame && !(options_.frame->crs() == json_.crs)) {
      faults_.Add(InputError(Full("scene.json"), "crs", "another coordinate system", "that of the base job"));
      return;
    }
    StatusOr<Frame> frame = options_.frame ? *options_.frame : Frame::Around(json_.crs, median);
    if (!frame.ok()) {
      faults_.Add(absl::InvalidArgumentError(
          absl::StrCat(Full(scene_.files.front()), ": ", std::string(frame.status().message()))));
      return;
    }
    scene_.frame = *frame;
    const Eigen::Matrix3d scene_from_local = frame->rotation_local_from_scene().transpose();
    for (const CalibratedImage& image : model.images) {
      SceneView view;
      view.name = image.name;
      view.lens = model.cameras.at(image.camera_id);
      view.camera.intrinsics = view.lens.pinhole;
      view.camera.rotation_cam_from_world = image.rotation_cam_from_world * scene_from_local;
      view.camera.translation_cam_from_world =
          image.rotation_cam_from_world * frame->origin_in_scene() + image.translation_cam_from_world;
      scene_.views.push_back(std::move(view));
    }
    has_all_views_ = faults_.messages().size() == faults_before;
  }

  // Finds the files of the images, and reads their headers in parallel. Faults of files are reported in the order of
  // the views. Views get the names of their files.
  void FindImages() {
    for (const SceneView& view : scene_.views) model_names_.push_back(view.name);
    const ImageFiles found = FindImageFiles(
        model_names_,
        [&](const std::string& name) {
          const StatusOr<std::string> inside = JoinInside(json_.images.path, name);
          return inside.ok() && (options_.elsewhere.contains(*inside) || options_.allowed.Exists(Full(*inside)));
        },
        [&] { return ListImages(); });
    if (found.other_case > 0) {
      Warn(absl::StrCat(json_.images.path, ": ", found.other_case,
                        " images have files whose names differ in upper and lower case, such as '",
                        found.other_case_file, "' for '", found.other_case_name, "'"));
    }
    std::vector<std::string> paths(scene_.views.size());  // of the files to check; relative to the scene's folder
    std::vector<std::string> missing, hints;
    std::map<std::string, size_t> view_of_file;
    std::vector<Status> of_names, broken(scene_.views.size());  // broken: errors of single files
    for (size_t i = 0; i < scene_.views.size(); ++i) {
      SceneView& view = scene_.views[i];
      const bool has_file = !found.files[i].empty();
      const StatusOr<std::string> inside =
          JoinInside(json_.images.path, has_file ? found.files[i] : PlainImageName(view.name));
      if (!inside.ok()) {
        of_names.push_back(InputError(Full(json_.cameras.path), "images", absl::StrCat("the name '", view.name, "'"),
                                      "a name inside the images folder"));
      } else if (!has_file) {
        broken[i] = InputError(Full(*inside), "", "no such file", "an image");
        missing.push_back(view.name);
        hints.push_back(found.hints[i]);
      } else if (const auto [first, is_new] = view_of_file.emplace(*inside, i); !is_new) {
        of_names.push_back(InputError(Full(*inside), "",
                                      absl::StrCat("one file for the images '", model_names_[first->second], "' and '",
                                                   view.name, "' of the COLMAP model"),
                                      "a file for each image"));
      } else {
        view.name = found.files[i];
        paths[i] = *inside;
      }
    }
    std::vector<StatusOr<std::optional<ImageHeader>>> read(scene_.views.size(), std::optional<ImageHeader>());
    ParallelForEach(scene_.views.size(), 1, [&](size_t i) {
      if (paths[i].empty()) return;
      read[i] = ReadHeader(paths[i], absl::StrCat("image '", scene_.views[i].name, "'"), &broken[i]);
    });
    if (const Status skipped = SkipImages(broken, options_.skip_images, warnings_, &scene_); skipped.ok()) {
      for (size_t i = 0; i < broken.size(); ++i) {
        if (!broken[i].ok() && !paths[i].empty()) scene_.files.push_back(paths[i]);
      }
      for (auto* list : {&paths, &model_names_}) KeepUsable(broken, list);
      KeepUsable(broken, &read);
      missing.clear();
    } else if (options_.skip_images > 0) {
      faults_.Add(skipped);
    }
    if (!missing.empty()) {
      faults_.Add(MissingImagesError(Full(json_.images.path), missing, hints, scene_.views.size()));
    }
    for (const Status& fault : of_names) faults_.Add(fault);
    std::vector<std::optional<ImageHeader>> headers(read.size());
    for (size_t i = 0; i < read.size(); ++i) {
      if (read[i].ok()) headers[i] = *read[i];
      scene_.views[i].masked = headers[i] && headers[i]->has_alpha;
    }
    const std::vector<Status> sizes = FitLenses(headers, json_.images.path, &scene_, warnings_);
    for (size_t i = 0; i < read.size(); ++i) {
      faults_.Add(read[i].status());
      faults_.Add(sizes[i]);
      if (paths[i].empty() || !read[i].ok() || !sizes[i].ok()) continue;
      scene_.views[i].image_path = paths[i];
      scene_.files.push_back(paths[i]);
    }
  }

  // All files of the images folder, relative to it; none if it cannot be listed.
  std::vector<std::string> ListImages() {
    const StatusOr<std::vector<std::string>> files = ListScene(json_.images.path);
    return files.ok() ? *files : std::vector<std::string>();
  }

  // All files of the folder at `relative`, relative to it, with those that are elsewhere; sorted.
  StatusOr<std::vector<std::string>> ListScene(const std::string& relative) const {
    std::vector<std::string> names;
    std::string prefix = relative + "/";
    while (prefix.ends_with("//")) prefix.pop_back();
    for (const std::string& file : options_.elsewhere) {
      if (file.starts_with(prefix)) names.push_back(file.substr(prefix.size()));
    }
    if (options_.allowed.IsFolder(Full(relative)).value_or(false)) {
      TESSERA_ASSIGN_OR_RETURN(const std::vector<std::string> files, options_.allowed.List(Full(relative)));
      names.insert(names.end(), files.begin(), files.end());
    }
    std::sort(names.begin(), names.end());
    names.erase(std::unique(names.begin(), names.end()), names.end());
    return names;
  }

  // The header of the file at `inside`, relative to the scene's folder; none if it is elsewhere. `what`: for errors.
  // `broken` (may be null): receives the error if the header cannot be read.
  StatusOr<std::optional<ImageHeader>> ReadHeader(const std::string& inside, const std::string& what,
                                                  Status* broken = nullptr) const {
    if (options_.elsewhere.contains(inside)) {
      const auto known = options_.headers_elsewhere.find(inside);
      if (known == options_.headers_elsewhere.end()) return std::nullopt;
      if (known->second.ok()) return *known->second;
      if (broken != nullptr) *broken = known->second.status();
      return known->second.status();
    }
    const std::string path = Full(inside);
    const StatusOr<AllowedFile> file = options_.allowed.Open(path);
    if (!file.ok()) {
      return absl::IsNotFound(file.status())
                 ? InputError(path, "", "no such file", absl::StrCat(what, " of the COLMAP model"))
                 : file.status();
    }
    const StatusOr<ImageHeader> header = ReadImageHeader(file->path());
    if (!header.ok()) {
      const Status fault = Named(header.status(), *file, path);
      if (broken != nullptr) *broken = fault;
      return fault;
    }
    return *header;
  }

  void FindMasks() {
    const std::string folder = json_.masks.path;
    if (json_.masks.given && !HasElsewhere(folder) && !IsFolder(Full(folder))) {
      return faults_.Add(InputError(Full(folder), "", "no such folder", "the masks that scene.json names"));
    }
    const StatusOr<std::vector<std::string>> files = ListScene(folder);
    if (!files.ok()) return faults_.Add(files.status());
    if (files->empty()) return;
    const std::vector<std::string> masks = FindMaskFiles(scene_, *files, folder, warnings_, &faults_);
    for (size_t v = 0; v < masks.size(); ++v) {
      if (masks[v].empty()) continue;
      SceneView& view = scene_.views[v];
      const std::string path = absl::StrCat(folder, "/", masks[v]);
      const StatusOr<std::optional<ImageHeader>> header =
          ReadHeader(path, absl::StrCat("the mask of image '", view.name, "'"));
      faults_.Add(header.status());
      if (!header.ok()) continue;
      view.mask_path = path;
      view.masked = true;
      scene_.files.push_back(path);
    }
  }

  // Whether files of the folder, relative to the scene's, are elsewhere.
  bool HasElsewhere(const std::string& folder) const {
    const auto first = options_.elsewhere.lower_bound(folder + "/");
    return first != options_.elsewhere.end() && first->starts_with(folder + "/");
  }

  void WarnOfDefault() {
    Warn(
        "likelihoods come from the default rule (geometry and greenness), not from a classifier trained on this scene: "
        "annotate a few images and run tessera classify --train");
  }

  void FindLikelihoods() {
    if (options_.to_be_classified) {
      scene_.has_likelihoods = true;
      if (options_.by_default_rule) WarnOfDefault();
      if (HasElsewhere(json_.likelihoods.path) || IsFolder(Full(json_.likelihoods.path))) {
        Warn(absl::StrCat(json_.likelihoods.path, ": not used, because the job computes likelihoods from the images"));
      }
      return;
    }
    const std::string folder = json_.likelihoods.path;
    if (!HasElsewhere(folder) && !IsFolder(Full(folder))) {
      if (json_.likelihoods.given) {
        faults_.Add(InputError(Full(folder), "", "no such folder", "the likelihoods that scene.json names"));
      }
      return;
    }
    const StatusOr<std::vector<std::string>> names = ListScene(folder);
    if (!names.ok()) return faults_.Add(names.status());
    std::map<std::string, std::vector<std::string>> by_stem, stems_of_lower;
    for (const std::string& file : *names) {
      const std::string extension = absl::AsciiStrToLower(fs::path(file).extension().string());
      if (extension == ".tif" || extension == ".tiff" || extension == ".npy" || extension == ".png") {
        by_stem[WithoutExtension(file)].push_back(file);
      }
    }
    for (const auto& [stem, files] : by_stem) stems_of_lower[absl::AsciiStrToLower(stem)].push_back(stem);
    scene_.has_likelihoods = true;
    if (json_.likelihoods_source == kDefaultLikelihoods) WarnOfDefault();
    const std::vector<std::string> stems = ViewStems(scene_);
    std::set<std::string> ambiguous;
    for (size_t v = 0; v < scene_.views.size(); ++v) {
      SceneView& view = scene_.views[v];
      // A file may also have the image's whole name, or the name in the model.
      auto it = by_stem.find(stems[v]);
      for (const std::string& other : {view.name, WithoutExtension(PlainImageName(model_names_[v]))}) {
        if (it == by_stem.end() && stems[v] != view.name) it = by_stem.find(other);
      }
      // It may differ from its image in the case of letters.
      for (const std::string& other : {stems[v], view.name}) {
        const auto same = stems_of_lower.find(absl::AsciiStrToLower(other));
        if (it != by_stem.end() || same == stems_of_lower.end() || same->second.size() > 1) continue;
        it = by_stem.find(same->second.front());
      }
      const std::string stem = WithoutExtension(view.name);
      const std::string path = absl::StrCat(Full(folder), "/", stems[v]);
      if (it == by_stem.end() && stems[v] == view.name && by_stem.contains(stem)) {
        if (!ambiguous.insert(stem).second) continue;
        const std::string& file = by_stem[stem].front();
        faults_.Add(InputError(
            absl::StrCat(Full(folder), "/", file), "",
            absl::StrCat("one name for the likelihoods of ", ImagesOfStem(stem)),
            absl::StrCat("a file for each, such as '", view.name, fs::path(file).extension().string(), "'")));
      } else if (it == by_stem.end()) {
        faults_.Add(InputError(path, "", "no .tif, .tiff, .npy or .png",
                               absl::StrCat("the likelihoods of image '", view.name, "'")));
      } else if (it->second.size() > 1) {
        faults_.Add(InputError(path, "", absl::StrCat(it->second.size(), " files"),
                               absl::StrCat("one for image '", view.name, "'")));
      } else {
        view.likelihood_path = absl::StrCat(folder, "/", it->second.front());
        view.likelihood_form = json_.likelihood_form;
        scene_.files.push_back(view.likelihood_path);
      }
    }
  }

  // "'a.jpg' and 'a.png'": the images whose names without extension are `stem`.
  std::string ImagesOfStem(const std::string& stem) const {
    std::string images;
    for (const SceneView& view : scene_.views) {
      if (WithoutExtension(view.name) != stem) continue;
      absl::StrAppend(&images, images.empty() ? "" : " and ", "'", view.name, "'");
    }
    return images;
  }

  void FindMesh() {
    const std::string& path = json_.mesh.path;
    StatusOr<std::string> head = std::string();
    if (options_.elsewhere.contains(path)) {
      const auto known = options_.heads_elsewhere.find(path);
      if (known == options_.heads_elsewhere.end()) {
        scene_.mesh_path = path;
        scene_.files.push_back(path);
        scene_.mesh_has_labels = true;  // not checked here; the base job has checked its mesh
        return;
      }
      head = known->second;
    } else if (!options_.allowed.Exists(Full(path)) || IsFolder(Full(path))) {
      scene_.mesh_has_labels = !options_.needs_mesh && !json_.mesh.given;
      if (scene_.mesh_has_labels) return;
      faults_.Add(InputError(Full(path), "", "no such file", "the start mesh"));
      return;
    } else {
      const StatusOr<AllowedFile> file = options_.allowed.Open(Full(path));
      if (!file.ok()) return faults_.Add(file.status());
      head = file->Read(0, kMeshHeadBytes);
    }
    if (head.ok() && IsLfsPointer(*head)) {
      scene_.mesh_has_labels = true;  // unknown
      return faults_.Add(LfsPointerError(Full(path)));
    }
    scene_.mesh_path = path;
    scene_.files.push_back(path);
    scene_.mesh_has_labels = head.ok() && HeadHasLabels(*head, json_.label_property);
  }

  void ChooseClasses() {
    scene_.classes = json_.classes;
    if (scene_.has_likelihoods || scene_.mesh_has_labels || options_.all_classes) return;
    if (json_.classes_given && scene_.classes.size() > 1) {
      Warn("scene.json has classes, but the scene has neither labels nor likelihoods: it is refined as one class");
    }
    scene_.classes = {OneClass()};
  }

  // An image belongs to the first flight with a pattern that matches its name.
  void AssignFlights() {
    for (const FlightEntry& entry : json_.flights) scene_.flights.push_back(entry.flight);
    std::vector<int64_t> images(json_.flights.size());
    for (SceneView& view : scene_.views) {
      view.flight = -1;
      for (size_t f = 0; f < json_.flights.size() && view.flight < 0; ++f) {
        for (const std::string& pattern : json_.flights[f].patterns) {
          if (fnmatch(pattern.c_str(), view.name.c_str(), 0) == 0) view.flight = static_cast<int>(f);
        }
      }
      if (view.flight >= 0) {
        ++images[view.flight];
      } else if (!json_.flights.empty()) {
        faults_.Add(InputError(Full("scene.json"), "flights", absl::StrCat("no flight with image '", view.name, "'"),
                               "a flight for each image"));
      }
    }
    for (size_t f = 0; f < images.size() && has_all_views_; ++f) {
      if (images[f] == 0)
        Warn(absl::StrCat("flight '", json_.flights[f].flight.name, "' has no images: check its patterns"));
    }
  }

  void SetUp() {
    if (!json_.up) return;
    if (scene_.frame.crs().kind == Crs::Kind::kLocal) {
      scene_.up_in_local = *json_.up;
    } else if (scene_.frame.crs().kind == Crs::Kind::kEcef
                   ? (scene_.frame.rotation_local_from_scene() * *json_.up).z() < 0.999
                   : json_.up->z() < 0.999999) {
      Warn("'up' is ignored: the coordinate system defines the up direction");
    }
  }

  const SceneLoadOptions& options_;
  Warnings* warnings_;
  Faults& faults_;
  SceneDescription scene_;
  SceneFile json_;
  bool has_all_views_ = false;            // of the model: it has no faults
  std::vector<std::string> model_names_;  // of the views
};

}  // namespace

SceneDescription LoadSceneCollecting(const std::string& path, const SceneLoadOptions& options, Warnings* warnings,
                                     Faults* faults) {
  const StatusOr<bool> is_folder = options.allowed.IsFolder(path);
  if (!is_folder.ok()) {
    faults->Add(is_folder.status());
    return {};
  }
  const bool is_file = !*is_folder && fs::path(path).extension() == ".json";
  std::string folder = is_file ? fs::path(path).parent_path().string() : path;
  while (folder.size() > 1 && folder.back() == '/') folder.pop_back();
  if (folder.empty()) folder.push_back('.');
  const std::string file = is_file ? path : absl::StrCat(folder, "/scene.json");
  if (!is_file && !*is_folder) {
    faults->Add(InputError(path, "", "no such folder", "a scene (a folder with a scene.json)"));
    return {};
  }
  return SceneLoader(folder, options, warnings, faults).Load(file);
}

StatusOr<SceneDescription> LoadScene(const std::string& path, Warnings* warnings, const SceneLoadOptions& options) {
  Faults faults;
  SceneDescription scene = LoadSceneCollecting(path, options, warnings, &faults);
  faults.Add(SkipAdvice(scene));
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  return scene;
}

}  // namespace tessera
