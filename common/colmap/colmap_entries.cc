#include "common/colmap/colmap_entries.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

constexpr int kTextOnly = -1;

// COLMAP 4 has the models from id 12.
constexpr ColmapCameraModel kModels[] = {
    {0, "SIMPLE_PINHOLE", 3, "f cx cy"},
    {1, "PINHOLE", 4, "fx fy cx cy"},
    {2, "SIMPLE_RADIAL", 4, "f cx cy k"},
    {3, "RADIAL", 5, "f cx cy k1 k2"},
    {4, "OPENCV", 8, "fx fy cx cy k1 k2 p1 p2"},
    {5, "OPENCV_FISHEYE", 8, nullptr},
    {6, "FULL_OPENCV", 12, "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"},
    {7, "FOV", 5, nullptr},
    {8, "SIMPLE_RADIAL_FISHEYE", 4, nullptr},
    {9, "RADIAL_FISHEYE", 5, nullptr},
    {10, "THIN_PRISM_FISHEYE", 12, nullptr},
    {11, "RAD_TAN_THIN_PRISM_FISHEYE", 16, nullptr},
    {12, "SIMPLE_DIVISION", 4, nullptr},
    {13, "DIVISION", 5, nullptr},
    {14, "SIMPLE_FISHEYE", 3, nullptr},
    {15, "FISHEYE", 4, nullptr},
    {16, "EUCM", 6, nullptr},
    {17, "EQUIRECTANGULAR", 2, nullptr},
    // Not of COLMAP: LensModel::Kind::kBrown, in text files only.
    {kTextOnly, "TESSERA_BROWN", 11, "fx fy cx cy k1 k2 p1 p2 k3 k4 skew"},
};
constexpr char kSupported[] =
    "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV or FULL_OPENCV: undistort the images with 'colmap "
    "image_undistorter' and use its model";
constexpr uint64_t kMaxSide_px = 1 << 20;

// Records the location of a key. If the key already exists, reports the duplicate and returns false.
template <class Map, class Key>
bool Claim(Map& locations, const Key& key, const ColmapLocation& location, const std::string& what, Faults& faults) {
  const auto [it, is_new] = locations.emplace(key, location.location);
  if (!is_new)
    faults.Add(
        location.Error(absl::StrCat(what, " again"), absl::StrCat("a unique id or name (first at ", it->second, ")")));
  return is_new;
}

// "RADIAL (f cx cy k1 k2)": the supported models with so many parameters; empty if there are none.
std::string ModelsOf(size_t parameters) {
  std::string names;
  for (const ColmapCameraModel& model : kModels) {
    if (model.order == nullptr || static_cast<size_t>(model.parameters) != parameters) continue;
    absl::StrAppend(&names, names.empty() ? "" : " or ", model.name, " (", model.order, ")");
  }
  return names;
}

StatusOr<LensModel> LensOf(const ColmapLocation& location, uint32_t id, const ColmapCameraModel* model,
                           const std::string& model_name, uint64_t width, uint64_t height,
                           const std::vector<double>& p) {
  if (model == nullptr || model->order == nullptr) {
    // Other programs have their own names for the same models, such as BROWN for one with radial distortion.
    const std::string likely = model == nullptr ? ModelsOf(p.size()) : "";
    return location.Error(
        absl::StrCat("camera model ", model_name, likely.empty() ? "" : absl::StrCat(" with ", p.size(), " parameters"),
                     likely.empty() ? "" : ", likely ", likely),
        kSupported);
  }
  if (static_cast<int>(p.size()) != model->parameters) {
    const std::string likely = ModelsOf(p.size());
    return location.Error(
        absl::StrCat(p.size(), " parameters for camera ", id, " of model ", model->name),
        absl::StrCat(model->parameters, " (", model->order, ")",
                     likely.empty() ? "" : absl::StrCat(", or the model that has ", p.size(), ", likely ", likely)));
  }
  if (width < 1 || height < 1 || width > kMaxSide_px || height > kMaxSide_px) {
    return location.Error(absl::StrCat("an image of ", width, " x ", height, " pixels"),
                          absl::StrCat("1 x 1 to ", kMaxSide_px, " x ", kMaxSide_px));
  }
  LensModel lens;
  lens.pinhole.width = static_cast<int>(width);
  lens.pinhole.height = static_cast<int>(height);
  const std::string name = model->name;
  const bool two_focal_lengths = std::string(model->order).starts_with("fx");
  size_t next = two_focal_lengths ? 2 : 1;
  lens.pinhole.fx = p[0];
  lens.pinhole.fy = two_focal_lengths ? p[1] : p[0];
  lens.pinhole.cx = p[next++];
  lens.pinhole.cy = p[next++];
  std::copy(p.begin() + next, p.end(), lens.coefficients);
  for (const double value : p) {
    if (!std::isfinite(value)) return location.Error(absl::StrCat("parameter ", value), "finite numbers");
  }
  if (!(lens.pinhole.fx > 0 && lens.pinhole.fy > 0)) {
    return location.Error(absl::StrCat("focal length ", std::min(lens.pinhole.fx, lens.pinhole.fy)), "more than 0");
  }
  if (std::any_of(std::begin(lens.coefficients), std::end(lens.coefficients), [](double k) { return k != 0; })) {
    lens.kind = name == "SIMPLE_RADIAL" ? LensModel::Kind::kSimpleRadial
                : name == "RADIAL"      ? LensModel::Kind::kRadial
                : name == "OPENCV"      ? LensModel::Kind::kOpenCv
                : name == "FULL_OPENCV" ? LensModel::Kind::kFullOpenCv
                                        : LensModel::Kind::kBrown;
  }
  return lens;
}

}  // namespace

const ColmapCameraModel* FindColmapCameraModel(const std::string& name) {
  for (const ColmapCameraModel& model : kModels) {
    if (name == model.name) return &model;
  }
  return nullptr;
}

const ColmapCameraModel* FindColmapCameraModel(int id) {
  for (const ColmapCameraModel& model : kModels) {
    if (id == model.id && id != kTextOnly) return &model;
  }
  return nullptr;
}

void ColmapBuilder::AddCamera(const ColmapLocation& location, uint32_t id, const ColmapCameraModel* model,
                              const std::string& model_name, uint64_t width, uint64_t height,
                              const std::vector<double>& parameters) {
  if (!Claim(camera_locations_, id, location, absl::StrCat("camera ", id), faults_)) return;
  const StatusOr<LensModel> lens = LensOf(location, id, model, model_name, width, height, parameters);
  if (lens.ok()) {
    model_.cameras.emplace(id, *lens);
  } else {
    camera_faults_.emplace(id, lens.status());
  }
}

void ColmapBuilder::AddImage(const ColmapLocation& location, CalibratedImage image, const double (&q)[4]) {
  if (!Claim(image_locations_, image.id, location, absl::StrCat("image ", image.id), faults_)) return;
  if (const auto fault = camera_faults_.find(image.camera_id); fault != camera_faults_.end()) {
    faults_.Add(fault->second);
    camera_faults_.erase(fault);
  }
  if (!Claim(name_locations_, image.name, location, absl::StrCat("image '", image.name, "'"), faults_)) return;
  const Eigen::Quaterniond quaternion(q[0], q[1], q[2], q[3]);
  const double norm = quaternion.norm();
  if (!std::isfinite(norm) || norm < 1e-6) {
    faults_.Add(
        location.Error(absl::StrCat("quaternion (", q[0], ", ", q[1], ", ", q[2], ", ", q[3], ")"), "a rotation"));
    return;
  }
  if (!image.translation_cam_from_world.allFinite()) {
    faults_.Add(location.Error("a translation that is not finite", "finite numbers"));
    return;
  }
  image.rotation_cam_from_world = quaternion.normalized().toRotationMatrix();
  camera_references_.push_back({location, {image.camera_id, image.name}});
  model_.images.push_back(std::move(image));
}

void ColmapBuilder::AddPoint(const ColmapLocation& location, TiePoint point) {
  if (!Claim(point_locations_, point.id, location, absl::StrCat("point ", point.id), faults_)) return;
  if (!point.position.allFinite()) {
    faults_.Add(location.Error("a position that is not finite", "finite numbers"));
    return;
  }
  model_.points.push_back(std::move(point));
}

void ColmapBuilder::Finish() {
  // Programs write cameras that no image uses, some with parameters that were never set.
  if (image_locations_.empty() || omits_cameras_) {
    for (const auto& [id, fault] : camera_faults_) faults_.Add(fault);
  }
  for (const auto& [location, reference] : camera_references_) {
    if (!omits_cameras_ && camera_locations_.count(reference.first) == 0) {
      faults_.Add(location.Error(absl::StrCat("camera ", reference.first, " for image '", reference.second, "'"),
                                 "the id of a camera in the cameras file"));
    }
  }
  std::sort(model_.images.begin(), model_.images.end(),
            [](const CalibratedImage& a, const CalibratedImage& b) { return a.id < b.id; });
  std::erase_if(model_.images,
                [&](const CalibratedImage& image) { return model_.cameras.count(image.camera_id) == 0; });
}

}  // namespace tessera
