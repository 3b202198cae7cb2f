// Conventions, from "RealityCapture XMP Camera Math" (support.capturingreality.com, 360017783459), "Registration export
// and camera orientations" (forums.unrealengine.com, 682588), and the export templates in RealityScan's
// calibration.xml:
//   XMP: Rotation R row by row, from the world to the camera; Position is the centre, t = -R Position. The camera's
//   axes are x right, y down, z forward. CSV: x, y, alt the centre. heading (or yaw): clockwise from the y axis; pitch:
//   from 0, down, to 90, horizontal; roll. All 0 is a camera that looks down with the upper side of the image to the y
//   axis. f = FocalLength35mm / 36 times the larger side; the principal point is the same share of the larger side off
//   the middle (f_35mm, px_norm, py_norm in newer tables, f, px, py in older ones). K = [f skew u; 0 f aspect v; 0 0
//   1]. brown3, brown4, with t2 in the name also tangential: k1 to k4 of r^2 to r^8 of the undistorted position; t1 and
//   t2 are OpenCV's p2 and p1 (RealityScan's table for OpenCV writes them in this order). Coefficients: k1 k2 k3 k4 t1
//   t2.
// Neither format has image sizes, a coordinate system or tie points.
#include "common/blocks/realityscan/realityscan.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <pugixml.hpp>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "common/blocks/block_parts.h"
#include "common/colmap/colmap_lines.h"
#include "common/meshio/text_words.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

constexpr char kXcrNamespace[] = "http://www.capturingreality.com/ns/xcr/1.1#";
constexpr int64_t kMaxSidecar_bytes = int64_t{64} << 20, kMaxTable_bytes = int64_t{1} << 30;
constexpr size_t kMaxXcrNumbers_bytes = 4096;  // of a property

// The properties of a sidecar: attributes or elements of rdf:Description in the namespace, whatever its prefix.
class XcrProperties {
 public:
  XcrProperties(const pugi::xml_document& document, std::string name, Faults* faults)
      : name_(std::move(name)), faults_(*faults) {
    pugi::xml_node node = document.document_element();
    if (LocalName(node) == "xmpmeta") node = node.first_child();
    while (node && LocalName(node) != "RDF") node = node.next_sibling();
    for (pugi::xml_node child = node.first_child(); child; child = child.next_sibling()) {
      if (LocalName(child) == "Description" && !Prefix(child).empty()) descriptions_.push_back(child);
    }
  }

  bool empty() const { return descriptions_.empty(); }

  std::string Text(const std::string& property) const {
    for (const pugi::xml_node& description : descriptions_) {
      const std::string name = absl::StrCat(Prefix(description), ":", property);
      if (const pugi::xml_attribute attribute = description.attribute(name.c_str())) return attribute.value();
      if (const pugi::xml_node child = description.child(name.c_str())) return child.text().get();
    }
    return "";
  }

  // The numbers of a property. False if it is not there, or with a fault if it does not have `count` finite numbers.
  bool Numbers(const std::string& property, size_t count, double* numbers) const {
    const std::string text = Text(property);
    if (text.empty()) return false;
    const auto fault = [&](const std::string& found) {
      faults_.Add(InputError(name_, absl::StrCat("xcr:", property), found, absl::StrCat(count, " finite numbers")));
      return false;
    };
    if (text.size() > kMaxXcrNumbers_bytes) return fault(absl::StrCat(text.size(), " characters"));
    const std::vector<std::string> words = absl::StrSplit(text, absl::ByAnyChar(" \t\r\n"), absl::SkipEmpty());
    if (words.size() != count) return fault(absl::StrCat(words.size(), " words"));
    for (size_t i = 0; i < count; ++i) {
      if (!ParseNumber(words[i], numbers[i]) || !(std::abs(numbers[i]) <= kMaxRealityScanNumber))
        return fault(Quoted(words[i]));
    }
    return true;
  }

 private:
  static std::string_view LocalName(const pugi::xml_node& node) {
    const std::string_view name = node.name();
    return name.substr(name.find(':') + 1);  // npos + 1 is 0
  }
  // Of the namespace, as the node or an ancestor declares it; empty if none does.
  static std::string Prefix(const pugi::xml_node& description) {
    for (pugi::xml_node node = description; node; node = node.parent()) {
      for (const pugi::xml_attribute& attribute : node.attributes()) {
        const std::string_view name = attribute.name();
        if (name.starts_with("xmlns:") && std::string_view(attribute.value()) == kXcrNamespace) {
          return std::string(name.substr(6));
        }
      }
    }
    return "";
  }

  std::string name_;
  Faults& faults_;
  std::vector<pugi::xml_node> descriptions_;
};

// Faults of the lens model and its coefficients.
void CheckXcrDistortion(const std::string& model, const std::array<double, 6>& distortion, const std::string& name,
                        Faults* faults) {
  const auto is_zero = [&](size_t begin, size_t end) {
    return std::all_of(distortion.begin() + static_cast<int>(begin), distortion.begin() + static_cast<int>(end),
                       [](double k) { return k == 0; });
  };
  if (is_zero(0, 6)) return;  // any model is then a pinhole
  struct Row {
    const char* model;
    size_t radial;
    bool is_tangential;
  };
  for (const Row& row : {Row{"brown3", 3, false}, Row{"brown4", 4, false}, Row{"brown3t2", 3, true},
                         Row{"brown4t2", 4, true}, Row{"perspective", 0, false}}) {
    if (model != row.model) continue;
    if (is_zero(row.radial, 4) && (row.is_tangential || is_zero(4, 6))) return;
    return faults->Add(InputError(name, "xcr:DistortionCoeficients", "coefficients that the lens model does not have",
                                  absl::StrCat("only those of ", model, " in k1 k2 k3 k4 t1 t2")));
  }
  faults->Add(InputError(name, "xcr:DistortionModel", model.empty() ? "no lens model" : Quoted(model),
                         "brown3, brown4, brown3t2 or brown4t2; set one of them under Alignment settings, Distortion "
                         "model, align again and export the sidecars again"));
}

bool IsRealityScanSidecar(const std::string& path) {
  const StatusOr<std::string> start = ReadFileRange(path, 0, 64 * 1024);
  return start.ok() && start->find(kXcrNamespace) != std::string::npos;
}

bool HasSidecarExtension(const std::string& path, const char* extension) {
  return absl::AsciiStrToLower(fs::path(path).extension().string()) == extension;
}

// The sidecars of a folder, relative to it; `others`: how many .xmp files of other programs.
std::vector<std::string> XcrSidecarsIn(const std::string& folder, int64_t* others) {
  std::vector<std::string> sidecars;
  const StatusOr<std::vector<std::string>> files = ListFiles(folder);
  if (!files.ok()) return sidecars;
  for (const std::string& file : *files) {
    if (!HasSidecarExtension(file, ".xmp")) continue;
    if (IsRealityScanSidecar(absl::StrCat(folder, "/", file))) {
      sidecars.push_back(file);
    } else {
      ++*others;
    }
  }
  return sidecars;
}

std::vector<std::string> RealityScanTablesIn(const std::string& folder) {
  std::vector<std::string> tables;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    if (HasSidecarExtension(entry.path().string(), ".csv") && IsRealityScanCsv(entry.path().string())) {
      tables.push_back(entry.path().string());
    }
  }
  std::sort(tables.begin(), tables.end());
  return tables;
}

struct XcrSidecar {
  std::string path;  // relative to the folder
  RealityScanCamera camera;
};

// Keeps the sidecars of one component: the one of this index in the order of ids, or the one with most images.
void KeepSidecarComponent(int component, const std::string& folder, std::vector<XcrSidecar>* sidecars,
                          ImportedBlock* block, Faults* faults) {
  std::map<std::string, int> sizes;
  for (const XcrSidecar& sidecar : *sidecars) ++sizes[sidecar.camera.component];
  if (component >= static_cast<int>(sizes.size())) {
    faults->Add(InputError(folder, "", absl::StrCat(sizes.size(), " components"),
                           absl::StrCat("component ", component, ", counted from 0")));
    return;
  }
  auto kept = sizes.begin();
  if (component >= 0) {
    std::advance(kept, component);
  } else {
    kept =
        std::max_element(sizes.begin(), sizes.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  }
  int index = 0;
  for (auto it = sizes.begin(); it != sizes.end(); ++it, ++index) {
    if (it == kept) continue;
    block->left_out.push_back(absl::StrCat("component ", index, " (", it->first, "): ", it->second,
                                           " images in a coordinate system of their own; --component ", index,
                                           " reads them"));
  }
  std::erase_if(*sidecars, [&](const XcrSidecar& s) { return s.camera.component != kept->first; });
}

void ReadXcrSidecars(const std::string& folder, const std::vector<std::string>& paths, const BlockReadOptions& options,
                     ImportedBlock* block, Faults* faults) {
  std::vector<XcrSidecar> sidecars;
  int64_t without_focal = 0;
  for (const std::string& path : paths) {
    const std::string file = absl::StrCat(folder, "/", path);
    block->files.push_back(file);
    const StatusOr<std::string> bytes = ReadFile(file, kMaxSidecar_bytes);
    if (!bytes.ok()) {
      faults->Add(bytes.status());
      continue;
    }
    XcrSidecar sidecar{path, {}};
    if (!ParseRealityScanXmp(*bytes, file, &sidecar.camera, faults)) continue;
    if (!sidecar.camera.has_focal) {
      ++without_focal;
      continue;
    }
    block->version = sidecar.camera.version;
    sidecars.push_back(std::move(sidecar));
  }
  if (without_focal > 0) {
    block->left_out.push_back(absl::StrCat(without_focal, " sidecars without a focal length"));
  }
  if (sidecars.empty()) {
    if (faults->empty()) faults->Add(InputError(folder, "", "no sidecar with a focal length", "at least one"));
    return;
  }
  KeepSidecarComponent(options.component, folder, &sidecars, block, faults);
  PhotographFiles files(folder, options.photographs);
  SharedCameras cameras(block);
  for (const XcrSidecar& sidecar : sidecars) {
    // IMAGE.xmp or IMAGE.jpg.xmp
    const std::string file = absl::StrCat(folder, "/", sidecar.path), name = file.substr(0, file.size() - 4);
    const StatusOr<std::string> photograph = files.Find(name);
    const StatusOr<ImageSize> size =
        photograph.ok() ? files.SizeOf(*photograph) : StatusOr<ImageSize>(photograph.status());
    if (!size.ok()) {
      faults->Add(ImageSizeFault(file, "", name, size.status(), block));
      continue;
    }
    const RealityScanCamera& camera = sidecar.camera;
    BlockImage& image = block->images.emplace_back();
    image.path = photograph->starts_with(folder + "/") ? photograph->substr(folder.size() + 1) : *photograph;
    image.location = sidecar.path;
    image.oriented = camera.has_rotation && camera.has_position;
    image.rotation_cam_from_block = camera.rotation_cam_from_block;
    image.centre = camera.position;
    image.camera = cameras.IndexOf(RealityScanLens(camera, *size), absl::StrCat("camera of ", image.path));
  }
  block->conventions.push_back(
      "RealityScan XMP: Rotation row by row, from the world to the camera; Position the centre.");
}

}  // namespace

LensModel RealityScanLens(const RealityScanCamera& camera, const ImageSize& size) {
  const double scale = std::max(size.width, size.height), focal_px = camera.focal_35mm / 36 * scale;
  const PinholeCamera pinhole{size.width,
                              size.height,
                              focal_px,
                              focal_px * camera.aspect,
                              size.width / 2.0 + camera.principal_u * scale,
                              size.height / 2.0 + camera.principal_v * scale};
  const auto& [k1, k2, k3, k4, t1, t2] = camera.distortion;
  return MakeBrownLens(pinhole, {k1, k2, k3, k4}, t2, t1, camera.skew * scale);
}

bool ParseRealityScanXmp(const std::string& bytes, const std::string& name, RealityScanCamera* camera, Faults* faults) {
  // pugixml expands no entities but the five of XML and skips document types.
  pugi::xml_document document;
  const pugi::xml_parse_result parsed = document.load_buffer(bytes.data(), bytes.size());
  if (!parsed) {
    faults->Add(InputError(name, absl::StrCat("byte ", parsed.offset), parsed.description(), "XML"));
    return false;
  }
  const XcrProperties properties(document, name, faults);
  if (properties.empty()) return false;
  const size_t faults_before = faults->messages().size();
  camera->version = properties.Text("Version");
  if (camera->version != "2" && camera->version != "3" && camera->version != "4") {
    faults->Add(InputError(name, "xcr:Version", Quoted(camera->version), "2, 3 or 4"));
  }
  camera->component = properties.Text("ComponentId");
  double rotation[9], position[3];
  camera->has_focal = properties.Numbers("FocalLength35mm", 1, &camera->focal_35mm);
  camera->has_rotation = properties.Numbers("Rotation", 9, rotation);
  camera->has_position = properties.Numbers("Position", 3, position);
  properties.Numbers("PrincipalPointU", 1, &camera->principal_u);
  properties.Numbers("PrincipalPointV", 1, &camera->principal_v);
  properties.Numbers("Skew", 1, &camera->skew);
  properties.Numbers("AspectRatio", 1, &camera->aspect);
  if (properties.Numbers("DistortionCoeficients", 6, camera->distortion.data())) {
    CheckXcrDistortion(properties.Text("DistortionModel"), camera->distortion, name, faults);
  }
  if (camera->has_focal && !(camera->focal_35mm > 0)) {
    faults->Add(InputError(name, "xcr:FocalLength35mm", absl::StrCat(camera->focal_35mm), "a focal length above 0"));
  }
  if (!(camera->aspect > 0)) {
    faults->Add(InputError(name, "xcr:AspectRatio", absl::StrCat(camera->aspect), "a ratio above 0"));
  }
  if (camera->has_rotation) {
    for (int k = 0; k < 9; ++k) camera->rotation_cam_from_block(k / 3, k % 3) = rotation[k];
    if (!MakeRotation(&camera->rotation_cam_from_block)) {
      faults->Add(InputError(name, "xcr:Rotation", "a matrix that is no rotation", "a rotation, row by row"));
    }
  }
  if (camera->has_position) camera->position << position[0], position[1], position[2];
  return faults->messages().size() == faults_before;
}

bool IsRealityScan(const std::string& path) {
  std::error_code error;
  if (!fs::is_directory(path, error)) {
    return HasSidecarExtension(path, ".xmp") ? IsRealityScanSidecar(path) : IsRealityScanCsv(path);
  }
  int64_t others = 0;
  return !RealityScanTablesIn(path).empty() || !XcrSidecarsIn(path, &others).empty();
}

ImportedBlock ReadRealityScan(const std::string& path, const BlockReadOptions& options, Faults* faults, Warnings*) {
  ImportedBlock block;
  std::error_code error;
  const bool is_folder = fs::is_directory(path, error), is_sidecar = !is_folder && HasSidecarExtension(path, ".xmp");
  const std::string absolute = AbsolutePath(path);
  const std::string folder = is_folder ? absolute : fs::path(absolute).parent_path().string();
  int64_t others = 0;
  const std::vector<std::string> sidecars =
      is_folder || is_sidecar ? XcrSidecarsIn(folder, &others) : std::vector<std::string>{};
  const std::vector<std::string> tables = is_folder ? RealityScanTablesIn(folder) : std::vector<std::string>{absolute};
  if (others > 0) block.left_out.push_back(absl::StrCat(others, " files .xmp without properties of RealityScan"));
  if (!sidecars.empty()) {
    if (is_folder && !tables.empty()) {
      block.left_out.push_back(absl::StrCat(absl::StrJoin(tables, ", "), ": the sidecars are read instead"));
    }
    ReadXcrSidecars(folder, sidecars, options, &block, faults);
  } else if (tables.size() != 1) {
    faults->Add(InputError(path, "", absl::StrCat(tables.size(), " tables of camera parameters"),
                           "one; name it instead of the folder"));
  } else {
    block.files = {tables[0]};
    const StatusOr<std::string> text = ReadFile(tables[0], kMaxTable_bytes);
    if (!text.ok()) {
      faults->Add(text.status());
      return block;
    }
    PhotographFiles files(folder, options.photographs);
    ParseRealityScanCsv(
        *text, tables[0], [&files](const std::string& image) { return files.SizeOf(image); }, &block, faults);
  }
  block.conventions.push_back(
      "RealityScan: focal length and principal point are shares of the larger side; t1 and t2 are OpenCV's p2 and p1.");
  block.left_out.push_back("tie points: RealityScan does not write them in this format");
  return block;
}

}  // namespace tessera
