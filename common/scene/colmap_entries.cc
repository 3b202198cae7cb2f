#include "common/scene/colmap_entries.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

constexpr ColmapCameraModel kModels[] = {
    {0, "SIMPLE_PINHOLE", 3, true},
    {1, "PINHOLE", 4, true},
    {2, "SIMPLE_RADIAL", 4, true},
    {3, "RADIAL", 5, true},
    {4, "OPENCV", 8, true},
    {5, "OPENCV_FISHEYE", 8, false},
    {6, "FULL_OPENCV", 12, true},
    {7, "FOV", 5, false},
    {8, "SIMPLE_RADIAL_FISHEYE", 4, false},
    {9, "RADIAL_FISHEYE", 5, false},
    {10, "THIN_PRISM_FISHEYE", 12, false},
};
constexpr char kSupported[] = "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV or FULL_OPENCV";
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

}  // namespace

const ColmapCameraModel* FindColmapCameraModel(const std::string& name) {
  for (const ColmapCameraModel& model : kModels) {
    if (name == model.name) return &model;
  }
  return nullptr;
}

const ColmapCameraModel* FindColmapCameraModel(int id) {
  for (const ColmapCameraModel& model : kModels) {
    if (id == model.id) return &model;
  }
  return nullptr;
}

void ColmapBuilder::AddCamera(const ColmapLocation& location, uint32_t id, const ColmapCameraModel* model,
                              const std::string& model_name, uint64_t width, uint64_t height,
                              const std::vector<double>& p) {
  if (!Claim(camera_locations_, id, location, absl::StrCat("camera ", id), faults_)) return;
  if (model == nullptr || !model->supported) {
    faults_.Add(location.Error(absl::StrCat("camera model ", model_name), kSupported));
    return;
  }
  if (static_cast<int>(p.size()) != model->parameters) {
    faults_.Add(
        location.Error(absl::StrCat(p.size(), " parameters"), absl::StrCat(model->parameters, " for ", model->name)));
    return;
  }
  if (width < 1 || height < 1 || width > kMaxSide_px || height > kMaxSide_px) {
    faults_.Add(location.Error(absl::StrCat("an image of ", width, " x ", height, " pixels"),
                               absl::StrCat("1 x 1 to ", kMaxSide_px, " x ", kMaxSide_px)));
    return;
  }
  LensModel lens;
  lens.pinhole.width = static_cast<int>(width);
  lens.pinhole.height = static_cast<int>(height);
  const std::string name = model->name;
  const bool two_focal_lengths = name == "PINHOLE" || name == "OPENCV" || name == "FULL_OPENCV";
  size_t next = two_focal_lengths ? 2 : 1;
  lens.pinhole.fx = p[0];
  lens.pinhole.fy = two_focal_lengths ? p[1] : p[0];
  lens.pinhole.cx = p[next++];
  lens.pinhole.cy = p[next++];
  std::copy(p.begin() + next, p.end(), lens.coefficients);
  for (const double value : p) {
    if (!std::isfinite(value)) {
      faults_.Add(location.Error(absl::StrCat("parameter ", value), "finite numbers"));
      return;
    }
  }
  if (!(lens.pinhole.fx > 0 && lens.pinhole.fy > 0)) {
    faults_.Add(
        location.Error(absl::StrCat("focal length ", std::min(lens.pinhole.fx, lens.pinhole.fy)), "more than 0"));
    return;
  }
  if (std::any_of(std::begin(lens.coefficients), std::end(lens.coefficients), [](double k) { return k != 0; })) {
    lens.kind = name == "SIMPLE_RADIAL" ? LensModel::Kind::kSimpleRadial
                : name == "RADIAL"      ? LensModel::Kind::kRadial
                : name == "OPENCV"      ? LensModel::Kind::kOpenCv
                                        : LensModel::Kind::kFullOpenCv;
  }
  model_.cameras.emplace(id, lens);
}

void ColmapBuilder::AddImage(const ColmapLocation& location, CalibratedImage image, const double (&q)[4]) {
  if (!Claim(image_locations_, image.id, location, absl::StrCat("image ", image.id), faults_)) return;
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
  for (const auto& [location, reference] : camera_references_) {
    if (camera_locations_.count(reference.first) == 0) {
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
