#include "common/check/inspection.h"

#include <algorithm>
#include <atomic>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "common/base/json_bounds.h"
#include "common/base/parallel.h"
#include "common/scene/image_files.h"
#include "common/scene/photographs.h"
#include "common/storage/allowed_files.h"
#include "common/storage/hash.h"

namespace tessera {
namespace {

using nlohmann::json;

constexpr size_t kComparedViews = 64;         // with the mesh's labels; at most about twice as many
constexpr char kSceneFolderMark[] = "\x01/";  // in place of the scene's folder, which differs between tasks

// Everything beside the bytes of the files that decides what InspectView finds.
std::string InspectionKey(const SceneView& view, int classes) {
  const PinholeCamera& camera = view.lens.pinhole;
  std::string key =
      absl::StrFormat("%s\n%s\n%s\n%d %d\n%d %d %d %a %a %a %a", view.image_path, view.mask_path, view.likelihood_path,
                      view.white_level, view.likelihood_path.empty() ? 0 : classes, static_cast<int>(view.lens.kind),
                      camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy);
  for (const double coefficient : view.lens.coefficients) absl::StrAppendFormat(&key, " %a", coefficient);
  const LikelihoodForm& form = view.likelihood_form;
  absl::StrAppendFormat(&key, "\n%d %d %d", static_cast<int>(form.layout), static_cast<int>(form.values),
                        form.first_id.value_or(-1));
  for (const auto& color : form.colors) absl::StrAppendFormat(&key, " %d,%d,%d", color[0], color[1], color[2]);
  return Xxh3Hex(key.data(), key.size());
}

std::string RgbKey(const SceneView& view) { return absl::StrCat(view.white_level, " ", view.image_path); }

bool HasFiles(const SceneView& view) { return !view.image_path.empty() || !view.likelihood_path.empty(); }

std::vector<std::array<uint8_t, 3>> ColorsOf(const SceneDescription& scene) {
  std::vector<std::array<uint8_t, 3>> colors;
  for (const SceneClass& c : scene.classes) colors.push_back(c.color_rgb);
  return colors;
}

template <class Number>
Number IntegerOf(const json& j) {
  const auto value = j.is_number_integer() ? j.get<int64_t>() : std::numeric_limits<int64_t>::min();
  if (std::in_range<Number>(value)) return static_cast<Number>(value);
  throw json::type_error::create(302, "expected an integer within range", &j);
}

json StatusToJson(const Status& status, const std::string& folder) {
  const auto marked = [&](const std::string& text) {
    return absl::StrReplaceAll(text, {{folder + "/", kSceneFolderMark}});
  };
  json faults = json::array();
  for (const InputFault& fault : FaultsOf(status)) {
    faults.push_back({marked(fault.file), fault.location, fault.found, fault.expected});
  }
  return {{"message", marked(std::string(status.message()))}, {"faults", std::move(faults)}};
}

Status StatusOf(const json& j, const std::string& folder) {
  const auto named = [&](const std::string& text) {
    return absl::StrReplaceAll(text, {{kSceneFolderMark, folder + "/"}});
  };
  Status status = absl::InvalidArgumentError(named(j.at("message").get<std::string>()));
  std::vector<InputFault> faults;
  for (const json& fault : j.at("faults")) {
    faults.push_back({named(fault.at(0).get<std::string>()), fault.at(1).get<std::string>(),
                      fault.at(2).get<std::string>(), fault.at(3).get<std::string>()});
  }
  SetFaults(status, faults);
  return status;
}

json HeaderToJson(const StatusOr<ImageHeader>& header, const std::string& folder) {
  if (!header.ok()) return StatusToJson(header.status(), folder);
  return {header->size.width, header->size.height, header->bits, header->has_alpha, header->orientation};
}

StatusOr<ImageHeader> ImageHeaderOf(const json& j, const std::string& folder) {
  if (j.is_object()) return StatusOf(j, folder);
  return ImageHeader{{IntegerOf<int>(j.at(0)), IntegerOf<int>(j.at(1))},
                     IntegerOf<int>(j.at(2)),
                     j.at(3).get<bool>(),
                     IntegerOf<int>(j.at(4))};
}

json LabelsToJson(const LabelContent& labels) {
  return {static_cast<int>(labels.kind),
          labels.has_class_colors,
          labels.has_ids,
          labels.highest_id,
          labels.zeros,
          labels.pixels};
}

LabelContent LabelsOf(const json& j) {
  return {static_cast<LabelContent::Kind>(IntegerOf<int>(j.at(0))),
          j.at(1).get<bool>(),
          j.at(2).get<bool>(),
          IntegerOf<int64_t>(j.at(3)),
          IntegerOf<int64_t>(j.at(4)),
          IntegerOf<int64_t>(j.at(5))};
}

// Runs of equal classes: class, length, class, ...
json RunsOf(const LabelImage& image) {
  json runs = json::array();
  for (size_t first = 0, end = 0; first < image.data.size(); first = end) {
    while (end < image.data.size() && image.data[end] == image.data[first]) ++end;
    runs.push_back(image.data[first]);
    runs.push_back(end - first);
  }
  return {{"size", {image.width, image.height}}, {"runs", std::move(runs)}};
}

LabelImage ImageOf(const json& j, int classes) {
  constexpr int kMostPixels = 1 << 16;  // of a digest
  const int width = IntegerOf<uint16_t>(j.at("size").at(0)), height = IntegerOf<uint16_t>(j.at("size").at(1));
  LabelImage image;
  const json& runs = j.at("runs");
  for (size_t i = 0; i < runs.size(); i += 2) {
    const auto label = IntegerOf<uint8_t>(runs.at(i));
    const auto length = IntegerOf<uint32_t>(runs.at(i + 1));
    if (label != 255 && label >= classes) throw json::out_of_range::create(401, "expected a class", &runs);
    if (length > kMostPixels - image.data.size()) throw json::out_of_range::create(401, "too many pixels", &runs);
    image.data.insert(image.data.end(), length, label);
  }
  image.width = width, image.height = height;
  if (image.plane_size() != image.data.size()) throw json::out_of_range::create(401, "another size", &runs);
  return image;
}

json InspectionToJson(const ViewInspection& found, int classes, const std::string& folder) {
  json j = json::object();
  if (!found.broken.ok()) {
    j["broken"] = StatusToJson(found.broken, folder);
  } else if (!found.content.ok()) {
    j["fault"] = StatusToJson(found.content.status(), folder);
  } else {
    if (!found.content->image.empty()) j["image"] = found.content->image;
    if (!found.content->likelihood.empty()) j["likelihood"] = found.content->likelihood;
    if (found.content->masked_share != 0) j["masked_share"] = found.content->masked_share;
  }
  if (!found.digest.is_read) return j;
  j["classes"] = classes;
  j["borders"] = found.borders.ToCounts();
  j["flat"] = found.digest.is_flat;
  j["sums"] = {found.digest.low_sum, found.digest.high_sum};
  if (!found.digest.classes.empty()) j["digest"] = RunsOf(found.digest.classes);
  return j;
}

StatusOr<ViewInspection> InspectionOf(const json& j, const std::string& folder) {
  ViewInspection found;
  if (j.contains("broken")) found.broken = StatusOf(j["broken"], folder);
  found.content = PixelContent{j.value("image", ""), j.value("likelihood", ""), j.value("masked_share", 0.0)};
  if (j.contains("fault")) found.content = StatusOf(j["fault"], folder);
  if (!j.contains("classes")) return found;
  const int classes = IntegerOf<uint8_t>(j["classes"]);
  std::vector<int64_t> borders;
  for (const json& count : j.at("borders")) borders.push_back(IntegerOf<int64_t>(count));
  TESSERA_ASSIGN_OR_RETURN(found.borders, BorderCounts::FromCounts(classes, borders));
  found.digest.is_read = true;
  found.digest.is_flat = j.at("flat").get<bool>();
  const auto sum = [](const json& of) {
    return of.is_null() ? std::numeric_limits<double>::infinity() : of.get<double>();
  };
  found.digest.low_sum = sum(j.at("sums").at(0));
  found.digest.high_sum = sum(j.at("sums").at(1));
  if (j.contains("digest")) found.digest.classes = ImageOf(j["digest"], classes);
  return found;
}

}  // namespace

ViewInspection InspectView(const std::string& folder, const SceneView& view, int classes) {
  ViewInspection found;
  found.borders = BorderCounts(classes);
  found.content = ReadPixelContent(folder, view, classes, &found.borders, &found.digest, &found.broken);
  return found;
}

size_t ComparedStep(size_t views) { return std::max<size_t>(1, views / kComparedViews); }

StatusOr<PartInspection> InspectPart(const std::string& folder, const SceneLoadOptions& load,
                                     const TaskControl& control) {
  SceneLoadOptions part = load;
  part.needs_mesh = false;
  part.all_classes = true;
  Warnings unused;  // validation of the whole scene gives the warnings and the faults
  Faults of_scene;
  SceneDescription scene = LoadSceneCollecting(folder, part, &unused, &of_scene);
  const int classes = static_cast<int>(scene.classes.size());
  const std::vector<std::array<uint8_t, 3>> colors = ColorsOf(scene);
  std::vector<size_t> here;  // views
  for (size_t v = 0; v < scene.views.size(); ++v) {
    if (HasFiles(scene.views[v])) here.push_back(v);
  }
  std::map<std::string, int> highest;
  std::map<std::string, LabelContent> labels;
  std::vector<int> highest_of(here.size());
  std::vector<LabelContent> labels_of(here.size());
  ParallelForEach(here.size(), 1, [&](size_t i) {
    const SceneView& view = scene.views[here[i]];
    if (!control.Check().ok()) return;
    if (!view.image_path.empty()) highest_of[i] = HighestSample(absl::StrCat(folder, "/", view.image_path)).value_or(0);
    if (!view.likelihood_path.empty()) {
      labels_of[i] = ReadLabelContent(absl::StrCat(folder, "/", view.likelihood_path), colors);
    }
  });
  TESSERA_RETURN_IF_ERROR(control.Check());
  for (size_t i = 0; i < here.size(); ++i) {
    const SceneView& view = scene.views[here[i]];
    if (!view.image_path.empty()) highest[view.image_path] = highest_of[i];
    if (!view.likelihood_path.empty()) labels[view.likelihood_path] = labels_of[i];
  }
  TESSERA_RETURN_IF_ERROR(
      ChooseWhiteLevels(std::vector<uint8_t>(scene.views.size(), 1), control, &scene, &unused, highest));
  FindLikelihoodForms(&scene, &unused, {}, labels);

  const size_t compared = ComparedStep(scene.views.size());
  std::vector<ViewInspection> found(here.size());
  std::atomic<int64_t> done = 0;
  ParallelForEach(here.size(), 1, [&](size_t i) {
    const SceneView& view = scene.views[here[i]];
    if (!control.Check().ok()) return;
    found[i] = InspectView(folder, view, classes);
    if (here[i] % compared != 0) found[i].digest.classes = LabelImage();
    if (load.to_be_classified && !view.image_path.empty()) {
      const auto rgb = ReadRgb(absl::StrCat(folder, "/", view.image_path), view.white_level);
      if (rgb.ok()) found[i].rgb = Xxh3Hex(rgb->data.data(), rgb->data.size());
    }
    const int64_t now = ++done;
    control.Report(static_cast<double>(now) / static_cast<double>(here.size()),
                   absl::StrCat("images, ", now, " of ", here.size()));
  });
  TESSERA_RETURN_IF_ERROR(control.Check());

  PartInspection inspection;
  json files = json::object(), views = json::array();
  const StatusOr<std::vector<std::string>> paths = AllowedFiles::All().List(folder);
  TESSERA_RETURN_IF_ERROR(paths.status());
  for (const std::string& path : *paths) {
    if (!IsPixelFile(path)) continue;
    const auto of_labels = labels.find(path);
    json& file = files[path] = json::object();
    if (of_labels == labels.end()) {  // an image or a mask
      const StatusOr<ImageHeader> header = ReadImageHeader(absl::StrCat(folder, "/", path));
      inspection.has_faults |= !header.ok();
      file["header"] = HeaderToJson(header, folder);
    } else if (of_labels->second.kind != LabelContent::Kind::kNoLabels) {
      file["labels"] = LabelsToJson(of_labels->second);
    }
    if (const auto of_image = highest.find(path); of_image != highest.end()) file["highest"] = of_image->second;
  }
  for (size_t i = 0; i < here.size(); ++i) {
    const SceneView& view = scene.views[here[i]];
    json entry = InspectionToJson(found[i], classes, folder);
    inspection.has_faults |= entry.contains("broken") || entry.contains("fault");
    entry["key"] = InspectionKey(view, classes);
    if (!found[i].rgb.empty()) entry["rgb"] = {RgbKey(view), found[i].rgb};
    views.push_back(std::move(entry));
  }
  inspection.json = json{{"files", std::move(files)}, {"views", std::move(views)}}.dump(-1, ' ', false,
                                                                                        json::error_handler_t::replace);
  return inspection;
}

Status Inspections::Add(const std::string& text, const std::string& folder) {
  TESSERA_RETURN_IF_ERROR(CheckJsonDepth("inspection", text));
  try {
    const json j = json::parse(text);
    for (const auto& [path, file] : j.at("files").items()) {
      const auto header = file.find("header");
      headers_.emplace(path,
                       header == file.end() ? StatusOr<ImageHeader>(ImageHeader()) : ImageHeaderOf(*header, folder));
      if (const auto highest = file.find("highest"); highest != file.end()) {
        highest_samples_[path] = IntegerOf<int>(*highest);
      }
      if (header == file.end()) {
        label_contents_[path] = file.contains("labels") ? LabelsOf(file["labels"]) : LabelContent();
      }
    }
    for (const json& view : j.at("views")) {
      TESSERA_ASSIGN_OR_RETURN(ViewInspection found, InspectionOf(view, folder));
      if (view.contains("rgb")) {
        rgb_[view["rgb"].at(0).get<std::string>()] = view["rgb"].at(1).get<std::string>();
      }
      views_.insert_or_assign(view.at("key").get<std::string>(), std::move(found));
    }
  } catch (const json::exception& e) {
    return absl::InvalidArgumentError(absl::StrCat("inspection: ", e.what()));
  }
  return absl::OkStatus();
}

void Inspections::AddTo(SceneLoadOptions* load) const {
  for (const auto& [path, header] : headers_) {
    load->elsewhere.insert(path);
    if (!label_contents_.contains(path)) load->headers_elsewhere.insert_or_assign(path, header);
  }
}

const ViewInspection* Inspections::Find(const SceneView& view, int classes, bool compared) const {
  if (!HasFiles(view)) return nullptr;
  const auto found = views_.find(InspectionKey(view, classes));
  if (found == views_.end()) return nullptr;
  const ViewInspection& inspection = found->second;
  if (!inspection.digest.is_read) return &inspection;
  if (inspection.borders.classes() != classes || (compared && inspection.digest.classes.empty())) return nullptr;
  return &inspection;
}

std::string Inspections::RgbOf(const SceneView& view) const {
  const auto found = rgb_.find(RgbKey(view));
  return found == rgb_.end() ? "" : found->second;
}

Status FetchInScene(const std::string& folder, const std::vector<std::string>& paths, const FetchFiles& fetch) {
  if (!fetch) return absl::OkStatus();
  std::vector<std::string> full;
  for (const std::string& path : paths) {
    if (!path.empty()) full.push_back(absl::StrCat(folder, "/", path));
  }
  return full.empty() ? absl::OkStatus() : fetch(full);
}

Status CompletePixelForms(const std::vector<uint8_t>& is_read, const std::map<std::string, LikelihoodForm>& known,
                          const InspectedFiles& files, const TaskControl& control, SceneDescription* scene,
                          Warnings* warnings) {
  const std::map<std::string, int>& highest = files.inspections.highest_samples();
  const std::map<std::string, LabelContent>& labels = files.inspections.label_contents();
  std::vector<std::string> unknown;
  for (size_t v = 0; v < scene->views.size(); ++v) {
    const SceneView& view = scene->views[v];
    if (is_read[v] && !highest.contains(view.image_path)) unknown.push_back(view.image_path);
    if (!known.contains(view.likelihood_path) && !labels.contains(view.likelihood_path)) {
      unknown.push_back(view.likelihood_path);
    }
  }
  TESSERA_RETURN_IF_ERROR(FetchInScene(scene->folder, unknown, files.fetch));
  TESSERA_RETURN_IF_ERROR(ChooseWhiteLevels(is_read, control, scene, warnings, highest));
  FindLikelihoodForms(scene, warnings, known, labels);
  return absl::OkStatus();
}

}  // namespace tessera
