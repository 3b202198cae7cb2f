#include "common/blocks/metashape/metashape.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <unordered_map>
#include <unordered_set>

#include "absl/strings/str_cat.h"
#include "common/base/printable.h"
#include "common/blocks/block_parts.h"
#include "common/blocks/metashape/metashape_crs.h"
#include "common/blocks/metashape/metashape_files.h"
#include "common/blocks/metashape/metashape_lens.h"
#include "common/blocks/metashape/ply_columns.h"

namespace tessera {
namespace {

constexpr double kMostMetashapeCoordinate = 1e100;
constexpr double kLeastEarthRadius_m = 6.2e6, kMostEarthRadius_m = 6.5e6;

// The id that a column has; -1: none.
int64_t WholeId(double value) { return value >= 0 && value < 1e15 ? static_cast<int64_t>(value) : -1; }

// p_to = scale R p_from + translation.
struct MetashapeTransform {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
  double scale = 1;
  bool IsNear(const MetashapeTransform& other) const {
    return rotation.isApprox(other.rotation, 1e-9) && translation.isApprox(other.translation, 1e-9) &&
           std::abs(scale - other.scale) <= 1e-9 * scale;
  }
};

MetashapeTransform operator*(const MetashapeTransform& a, const MetashapeTransform& b) {
  return {a.rotation * b.rotation, a.scale * (a.rotation * b.translation) + a.translation, a.scale * b.scale};
}

// Conventions (Metashape's manual and Python reference; checked on the tie points of a project of PhotoScan 1.2):
// camera/transform is the 4 x 4 matrix from the camera (x right, y down, z forward) to the chunk, row by row. The
// transforms of component and chunk have rotation, translation and scale and lead on to the reference system: into its
// earth-centred coordinates, if it is geographic or projected, else into its local ones. The centre of the first pixel
// is (0.5, 0.5).
class MetashapeReader {
 public:
  MetashapeReader(const std::string& name, const BlockReadOptions& options, MetashapeFiles files, ImportedBlock* block,
                  Faults* faults, Warnings* warnings)
      : name_(name),
        options_(options),
        files_(std::move(files)),
        block_(*block),
        faults_(faults),
        warnings_(*warnings) {}

  void Read() {
    block_.version = files_.version;
    block_.files = files_.files;
    const XmlNode chunk = files_.chunk;
    if (!chunk) return;
    for (XmlNode item = chunk.Child("sensors").Child("sensor"); item; item = item.Next("sensor")) {
      const std::optional<int64_t> id = item.IntegerAttribute("id", faults_);
      if (id && !sensors_.emplace(*id, Sensor{item}).second)
        item.AddFault(absl::StrCat("a second sensor ", *id), "each id once", faults_);
    }
    ReadComponents(chunk.Child("components"));
    for (XmlNode item = files_.frame.Child("cameras").Child("camera"); item; item = item.Next("camera")) {
      const std::optional<int64_t> id = item.IntegerAttribute("camera_id", faults_);
      if (id) photos_.emplace(*id, item.Child("photo").Attribute("path").value_or(""));
    }
    ReadCameras(chunk.Child("cameras"));
    if (block_.images.empty()) chunk.AddFault("no camera", "some", faults_);
    ChooseComponent(options_.component, name_, &block_, faults_);
    if (ReadPoints(files_.point_cloud)) ApplyTransforms(chunk);
    ReadMarkers(chunk);
    Finish();
  }

 private:
  struct Sensor {
    XmlNode node;
    int camera = -1;  // index into block_.cameras
    bool tried = false;
  };

  // The index of the sensor's camera; -1 with faults if it is not read.
  int CameraOf(Sensor* sensor) {
    if (sensor->tried) return sensor->camera;
    sensor->tried = true;
    BlockCamera camera;
    bool old_form = false;
    if (!ReadMetashapeSensor(sensor->node, &camera, &old_form, faults_)) return -1;
    (old_form ? old_forms_ : new_forms_) += 1;
    sensor->camera = static_cast<int>(block_.cameras.size());
    block_.cameras.push_back(camera);
    return sensor->camera;
  }

  void ReadComponents(const XmlNode& components) {
    for (XmlNode item = components.Child("component"); item; item = item.Next("component")) {
      const std::optional<int64_t> id = item.IntegerAttribute("id", faults_);
      if (!id) continue;
      if (*id < 0 || *id > 1'000'000'000) {
        item.AddFault(absl::StrCat("id ", *id), "a number from 0 on", faults_);
      } else if (!components_.emplace(static_cast<int>(*id), item).second) {
        item.AddFault(absl::StrCat("a second component ", *id), "each id once", faults_);
      }
    }
  }

  void ReadCameras(const XmlNode& cameras) {
    for (XmlNode item = cameras.Child("camera"); item; item = item.Next("camera")) ReadCamera(item);
    for (XmlNode group = cameras.Child("group"); group; group = group.Next("group")) ReadCameras(group);
  }

  void ReadCamera(const XmlNode& item) {
    const std::optional<int64_t> id = item.IntegerAttribute("id", faults_);
    if (!id) return;
    if (item.Attribute("master_id")) return void(++slaves_);
    BlockImage image;
    image.location = item.Location();
    image.path = PathOf(*id, std::string(item.Attribute("label").value_or("")));
    if (image.path.empty()) item.AddFault("no label", "the name of the photograph", faults_);
    image.component = components_.size() == 1 ? components_.begin()->first : 0;
    if (item.Attribute("component_id")) {
      const std::optional<int64_t> component = item.IntegerAttribute("component_id", faults_);
      if (component && !components_.contains(static_cast<int>(std::clamp<int64_t>(*component, -1, 2'000'000'000)))) {
        item.AddFault(absl::StrCat("component_id ", *component), "the id of a component", faults_);
      } else if (component) {
        image.component = static_cast<int>(*component);
      }
    }
    const std::string_view enabled = item.Attribute("enabled").value_or("true");
    const bool is_disabled = enabled == "false" || enabled == "0";
    disabled_ += is_disabled;
    rolling_ += static_cast<bool>(item.Child("rolling_shutter"));
    image.oriented = !is_disabled && item.Child("transform") && ReadPose(item.Child("transform"), &image);
    if (image.oriented) {
      const std::optional<int64_t> sensor_id = item.IntegerAttribute("sensor_id", faults_);
      const auto sensor = sensor_id ? sensors_.find(*sensor_id) : sensors_.end();
      if (sensor_id && sensor == sensors_.end()) {
        item.AddFault(absl::StrCat("sensor_id ", *sensor_id), "the id of a sensor", faults_);
      }
      image.camera = sensor == sensors_.end() ? -1 : CameraOf(&sensor->second);
      image.oriented = image.camera >= 0;
    }
    if (!images_.emplace(*id, block_.images.size()).second) {
      item.AddFault(absl::StrCat("a second camera ", *id), "each id once", faults_);
    }
    block_.images.push_back(image);
  }

  std::string PathOf(int64_t id, const std::string& label) const {
    const auto found = photos_.find(id);
    if (found == photos_.end() || found->second.empty()) return label;
    const std::string& path = found->second;
    const bool is_relative = !path.starts_with('/') && !path.starts_with('\\') && (path.size() < 2 || path[1] != ':');
    if (!is_relative || files_.photo_folder.empty()) return path;
    return (std::filesystem::path(files_.photo_folder) / path).lexically_normal();
  }

  bool ReadPose(const XmlNode& transform, BlockImage* image) {
    double m[16];
    if (!transform.Numbers(m, faults_)) return false;
    Eigen::Matrix3d rotation;
    rotation << m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10];
    const bool is_last_row = m[12] == 0 && m[13] == 0 && m[14] == 0 && m[15] == 1;
    if (!is_last_row || !MakeRotation(&rotation)) {
      transform.AddFault("a matrix that is no rotation and translation",
                         "orthonormal to 0.001, determinant 1, last row 0 0 0 1", faults_);
      return false;
    }
    image->rotation_cam_from_block = rotation.transpose();
    image->centre = {m[3], m[7], m[11]};
    return true;
  }

  MetashapeTransform ReadTransform(const XmlNode& node) {
    MetashapeTransform result;
    if (const XmlNode rotation = node.Child("rotation"); rotation) {
      double m[9];
      if (rotation.Numbers(m, faults_)) {
        result.rotation = Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(m);
        if (!MakeRotation(&result.rotation)) {
          rotation.AddFault("a matrix that is no rotation", "orthonormal to 0.001, determinant 1", faults_);
        }
      }
    }
    if (const XmlNode translation = node.Child("translation"); translation) {
      double t[3];
      if (translation.Numbers(t, faults_)) result.translation = {t[0], t[1], t[2]};
    }
    result.scale = node.ChildNumberOr("scale", 1, faults_);
    if (!(result.scale > 0)) node.AddFault(absl::StrCat("scale ", result.scale), "a positive one", faults_);
    return result;
  }

  void ApplyTransforms(const XmlNode& chunk) {
    int component = 0;
    for (const BlockImage& image : block_.images) {
      if (image.oriented) component = image.component;
    }
    const auto found = components_.find(component);
    const XmlNode inner = found == components_.end() ? XmlNode() : found->second.Child("transform");
    const XmlNode outer = chunk.Child("transform");
    const MetashapeTransform from_component = ReadTransform(inner), from_chunk = ReadTransform(outer);
    has_transform_ = inner || outer;
    // A chunk may repeat the transform of its active component.
    const MetashapeTransform all =
        inner && outer && from_component.IsNear(from_chunk) ? from_chunk : from_chunk * from_component;
    for (BlockImage& image : block_.images) {
      if (!image.oriented) continue;
      image.rotation_cam_from_block = image.rotation_cam_from_block * all.rotation.transpose();
      image.centre = all.scale * (all.rotation * image.centre) + all.translation;
    }
    for (BlockTiePoint& point : block_.points) {
      point.position = all.scale * (all.rotation * point.position) + all.translation;
    }
    ReadReference(chunk);
  }

  void ReadReference(const XmlNode& chunk) {
    const auto first = std::find_if(block_.images.begin(), block_.images.end(),
                                    [](const BlockImage& image) { return image.oriented; });
    if (first == block_.images.end()) return;
    const std::string reference(chunk.Child("reference").Text());
    const double distance = first->centre.norm();
    const bool is_earth_centred = distance > kLeastEarthRadius_m && distance < kMostEarthRadius_m;
    const std::string geocentric = GeocentricOf(reference);
    if (!has_transform_) {
      warnings_.push_back(
          absl::StrCat(name_, ": the chunk has no transform: its coordinates have no scale and no position"));
    } else if (is_earth_centred) {
      block_.crs = geocentric.empty() ? "EPSG:4978" : geocentric;
      if (!geocentric.empty() && reference != geocentric) block_.mesh_crs = reference;
      if (geocentric.empty()) {
        warnings_.push_back(absl::StrCat(name_,
                                         ": the file names no geographic reference system; its earth-centred "
                                         "coordinates are taken as WGS 84"));
      }
    } else if (!geocentric.empty()) {
      warnings_.push_back(absl::StrCat(name_, ": the reference system is geographic or projected, but the cameras are ",
                                       distance, " m from the centre of the Earth; they are taken as local"));
    }
  }

  // Points and their projections, in the chunk's coordinates. False with faults.
  bool ReadPoints(const XmlNode& cloud) {
    const XmlNode points = cloud.Child("points");
    if (!points) return true;
    std::vector<std::vector<double>> columns;
    if (!ReadColumns(points, {"x", "y", "z", "id?"}, &columns)) return false;
    std::unordered_map<int64_t, size_t> index;
    for (size_t row = 0; row < columns[0].size(); ++row) {
      BlockTiePoint point;
      point.position = {columns[0][row], columns[1][row], columns[2][row]};
      const int64_t id = columns[3].empty() ? static_cast<int64_t>(row) : WholeId(columns[3][row]);
      const bool is_bounded = point.position.cwiseAbs().maxCoeff() < kMostMetashapeCoordinate;
      if (!point.position.allFinite() || !is_bounded || !index.emplace(id, row).second) {
        points.AddFault(absl::StrCat("point ", row, " with the id of another or without a finite position"),
                        "finite positions, each id once", faults_);
        return false;
      }
      block_.points.push_back(point);
    }
    int64_t unknown_points = 0, unknown_images = 0;
    std::unordered_set<int64_t> seen;
    for (XmlNode item = cloud.Child("projections"); item; item = item.Next("projections")) {
      const std::optional<int64_t> id = item.IntegerAttribute("camera_id", faults_);
      if (!id) continue;
      if (!seen.insert(*id).second) {
        item.AddFault(absl::StrCat("a second list for camera ", *id), "one a camera", faults_);
        continue;
      }
      const auto image = images_.find(*id);
      unknown_images += image == images_.end();
      if (image == images_.end() || !ReadColumns(item, {"x", "y", "id"}, &columns)) continue;
      for (size_t row = 0; row < columns[0].size(); ++row) {
        const auto point = index.find(WholeId(columns[2][row]));
        const Eigen::Vector2d position(columns[0][row], columns[1][row]);
        if (point == index.end() || !position.allFinite()) {
          ++unknown_points;
        } else {
          block_.points[point->second].observations.push_back({static_cast<int>(image->second), position});
        }
      }
    }
    LeaveOut(unknown_points, "projections of tracks without a point");
    LeaveOut(unknown_images, "lists of projections in cameras that are not read");
    LeaveOut(DropUnorientedObservations(block_, &block_.points), "projections in photographs without a pose");
    return true;
  }

  bool ReadColumns(const XmlNode& item, const std::vector<std::string>& names,
                   std::vector<std::vector<double>>* columns) {
    const std::string member(item.Attribute("path").value_or(""));
    if (!files_.read_points) {
      item.AddFault("tie points outside of the file", "the project instead of the file alone", faults_);
      return false;
    }
    const StatusOr<std::string> bytes = files_.read_points(member);
    if (!bytes.ok()) {
      faults_->Add(bytes.status());
      return false;
    }
    StatusOr<std::vector<std::vector<double>>> read =
        ParsePlyColumns(*bytes, absl::StrCat(name_, "/", Printable(member)), names);
    if (!read.ok()) {
      faults_->Add(read.status());
      return false;
    }
    *columns = *std::move(read);
    return true;
  }

  // Markers with coordinates are control points, if those are in the system of the block: they are in that of the
  // reference, not earth-centred.
  void ReadMarkers(const XmlNode& chunk) {
    std::unordered_map<int64_t, BlockTiePoint> markers;
    int64_t elsewhere = 0;
    for (XmlNode item = chunk.Child("markers").Child("marker"); item; item = item.Next("marker")) {
      const std::optional<int64_t> id = item.IntegerAttribute("id", faults_);
      const XmlNode reference = item.Child("reference");
      if (!id || !reference.Attribute("x") || reference.Attribute("enabled") == "false") continue;
      const std::optional<double> x = reference.NumberAttribute("x", faults_);
      const std::optional<double> y = reference.NumberAttribute("y", faults_);
      const std::optional<double> z = reference.NumberAttribute("z", faults_);
      if (!x || !y || !z) continue;
      elsewhere += !block_.crs.empty() || !has_transform_;
      if (block_.crs.empty() && has_transform_) markers[*id].position = {*x, *y, *z};
    }
    LeaveOut(elsewhere, "markers with coordinates in another system than the poses");
    for (XmlNode item = files_.frame.Child("markers").Child("marker"); item; item = item.Next("marker")) {
      const std::optional<int64_t> id = item.IntegerAttribute("marker_id", faults_);
      const auto marker = id ? markers.find(*id) : markers.end();
      if (marker == markers.end()) continue;
      for (XmlNode seen = item.Child("location"); seen; seen = seen.Next("location")) {
        const std::optional<int64_t> camera = seen.IntegerAttribute("camera_id", faults_);
        const std::optional<double> x = seen.NumberAttribute("x", faults_), y = seen.NumberAttribute("y", faults_);
        const auto image = camera ? images_.find(*camera) : images_.end();
        if (!x || !y || image == images_.end()) continue;
        marker->second.observations.push_back({static_cast<int>(image->second), {*x, *y}});
      }
      block_.control_points.push_back(marker->second);
      markers.erase(marker);
    }
    DropUnorientedObservations(block_, &block_.control_points);
  }

  void LeaveOut(int64_t count, const std::string& what) {
    if (count > 0) block_.left_out.push_back(absl::StrCat(count, " ", what));
  }

  void Finish() {
    LeaveOut(slaves_, "cameras of a rig or a band that depend on a master camera");
    LeaveOut(disabled_, "disabled cameras");
    LeaveOut(rolling_, "motions of cameras during a rolling shutter");
    block_.conventions = {
        "a camera's matrix goes from the camera to the chunk, row by row; then the transforms of component and chunk "
        "follow",
        "positions in photographs count from the corner of the first pixel"};
    if (block_.crs.starts_with("EPSG:4978") || !block_.mesh_crs.empty()) {
      block_.conventions.push_back("positions are earth-centred");
    }
    if (new_forms_ > 0) {
      block_.conventions.push_back(
          "cx and cy count from the middle of the photograph, p1 belongs to r^2 + 2 x^2 and p2 to r^2 + 2 y^2, b1 is "
          "added to the focal length in x, b2 is the skew, k4 belongs to r^8");
    }
    if (old_forms_ > 0) {
      block_.conventions.push_back(
          "calibrations with fx: cx and cy count from the corner of the photograph, p1 and p2 are as in OpenCV");
    }
    if (HasTangential(block_)) block_.readings.push_back(ExchangedTangentialReading());
  }

  const std::string& name_;
  const BlockReadOptions& options_;
  MetashapeFiles files_;
  ImportedBlock& block_;
  Faults* faults_;
  Warnings& warnings_;
  std::map<int64_t, Sensor> sensors_;
  std::map<int, XmlNode> components_;
  std::unordered_map<int64_t, std::string> photos_;  // paths by camera id
  std::unordered_map<int64_t, size_t> images_;       // by camera id
  bool has_transform_ = false;
  int64_t old_forms_ = 0, new_forms_ = 0, slaves_ = 0, disabled_ = 0, rolling_ = 0;
};

}  // namespace

bool IsMetashape(const std::string& path) { return HasMetashapeFiles(path); }

ImportedBlock ReadMetashape(const std::string& path, const BlockReadOptions& options, Faults* faults,
                            Warnings* warnings) {
  ImportedBlock block;
  MetashapeReader(path, options, OpenMetashapeFiles(path, faults, warnings), &block, faults, warnings).Read();
  return block;
}

ImportedBlock ParseMetashape(std::string bytes, const std::string& name, const BlockReadOptions& options,
                             Faults* faults, Warnings* warnings) {
  ImportedBlock block;
  MetashapeReader(name, options, ParseMetashapeFiles(std::move(bytes), name, faults, warnings), &block, faults,
                  warnings)
      .Read();
  return block;
}

}  // namespace tessera
