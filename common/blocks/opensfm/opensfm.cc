// Conventions, from OpenSfM (opensfm.org/docs/geometry.html, opensfm/io.py, opensfm/actions/export_geocoords.py,
// src/geometry/camera_distortions_functions.h) and OpenDroneMap (stages/run_opensfm.py, opendm/shots.py):
// - "rotation" is the rotation vector (angle times axis) of R, "translation" t: x_cam = R X + t; x right, y down, z
//   forward. A shot of a rig has R = R_rig_camera R_rig_instance, t = R_rig_camera t_rig_instance + t_rig_camera.
// - Normalised image coordinates count from the centre of the image in units of max(width, height), in cameras and in
//   tracks.csv: u = width / 2 + max(width, height) x, v likewise.
// - brown has p1 and p2 in OpenCV's order: dx = 2 p1 x y + p2 (r^2 + 2 x^2).
// - Positions are east, north, up of reference_lla (a true local frame, on WGS 84). Newer versions of OpenDroneMap move
//   this to reconstruction.topocentric.json and write projected positions to reconstruction.json, less the offset in
//   the second line of coords.txt. odm_report/shots.geojson has projected positions, without an offset.
#include "common/blocks/opensfm/opensfm.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <unordered_map>
#include <unordered_set>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/base/json_bounds.h"
#include "common/base/printable.h"
#include "common/blocks/opensfm/opensfm_files.h"
#include "common/meshio/text_words.h"

namespace tessera {
namespace {

using Json = nlohmann::json;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kSfmLargest = 1e12;   // of coordinates, so that products stay finite
constexpr size_t kSfmMaxFaults = 100;  // of keys and points

const Json kSfmNone;

std::string SfmExcerpt(const Json& value) {
  if (std::any_of(value.begin(), value.end(), [](const Json& child) { return child.is_structured(); }))
    return absl::StrCat("an ", value.type_name(), " of ", value.size(), " entries");
  return absl::StrCat("'", value.dump(-1, ' ', true, Json::error_handler_t::replace).substr(0, 100), "'");
}

// `text` without the values that are not read and large. Null with a fault if it is no JSON or an object has a key
// twice.
Json ParseSfmJson(const std::string& file, std::string_view text, Faults* faults) {
  const Status depth = CheckJsonDepth(file, text);
  faults->Add(depth);
  if (!depth.ok()) return nullptr;
  std::vector<std::unordered_set<std::string>> keys(kMaxJsonDepth + 1);  // of the open objects, by depth
  const auto keep = [&](int at, Json::parse_event_t event, Json& parsed) {
    if (event == Json::parse_event_t::object_start) keys[at].clear();
    if (event != Json::parse_event_t::key) return true;
    const std::string key = parsed.get<std::string>();
    if (!keys[at - 1].insert(key).second && faults->messages().size() < kSfmMaxFaults)
      faults->Add(InputError(file, "", absl::StrCat("key ", Quoted(key), " twice in an object"), "a key once"));
    return key != "color" && key != "vertices" && key != "faces" && key != "covariance";
  };
  try {
    return Json::parse(text, keep);
  } catch (const Json::parse_error& error) {
    faults->Add(
        InputError(file, absl::StrCat("byte ", error.byte), "text that is no JSON", "JSON; the file may be cut"));
  } catch (const Json::exception& error) {
    faults->Add(InputError(file, "", Printable(error.what()), "JSON with numbers in a double's range"));
  }
  return nullptr;
}

// The value of `key`, null if there is none.
const Json& SfmMember(const Json& object, const std::string& key) {
  const auto it = object.is_object() ? object.find(key) : object.end();
  return object.is_object() && it != object.end() ? *it : kSfmNone;
}

std::optional<double> SfmNumber(const Json& value) {
  if (!value.is_number() || !std::isfinite(value.get<double>())) return std::nullopt;
  return value.get<double>();
}

std::optional<Vector3d> SfmVector(const Json& value) {
  if (!value.is_array() || value.size() != 3) return std::nullopt;
  Vector3d vector;
  for (int k = 0; k < 3; ++k) {
    const std::optional<double> number = SfmNumber(value[k]);
    if (!number.has_value() || std::abs(*number) > kSfmLargest) return std::nullopt;
    vector[k] = *number;
  }
  return vector;
}

struct SfmPose {
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  Vector3d t = Vector3d::Zero();
};

std::optional<SfmPose> ReadSfmPose(const Json& object) {
  const std::optional<Vector3d> rotation = SfmVector(SfmMember(object, "rotation"));
  const std::optional<Vector3d> translation = SfmVector(SfmMember(object, "translation"));
  if (!rotation.has_value() || !translation.has_value()) return std::nullopt;
  const double angle = rotation->norm();
  if (!std::isfinite(angle)) return std::nullopt;
  SfmPose pose;
  if (angle > 0) pose.R = Eigen::AngleAxisd(angle, *rotation / angle).toRotationMatrix();
  pose.t = *translation;
  return pose;
}

// Reads the lens of a camera; false with faults if it is not read.
bool ReadSfmLens(const Json& camera, const std::string& file, const std::string& location, LensModel* lens,
                 Faults* faults) {
  const Json& type = SfmMember(camera, "projection_type");
  const std::string model = type.is_string() ? type.get<std::string>() : type.is_null() ? "perspective" : "";
  if (model != "perspective" && model != "brown" && model != "simple_radial" && model != "radial") {
    faults->Add(InputError(file, location + ".projection_type", SfmExcerpt(type),
                           "perspective, brown, simple_radial or radial: process the images again with --camera-lens "
                           "brown (OpenDroneMap) or undistort them (OpenSfM), and take the block of that"));
    return false;
  }
  bool good = true;
  const auto number = [&](const char* key, bool required, double low, double high) {
    const Json& value = SfmMember(camera, key);
    if (value.is_null() && !required) return 0.0;
    const std::optional<double> found = SfmNumber(value);
    if (found.has_value() && *found >= low && *found <= high) return *found;
    faults->Add(InputError(file, absl::StrCat(location, ".", key), SfmExcerpt(value),
                           absl::StrCat("a number from ", low, " to ", high)));
    good = false;
    return 0.0;
  };
  const bool one_focal = model == "perspective";
  const double width = number("width", true, 1, 1e6), height = number("height", true, 1, 1e6);
  const double fx = number(one_focal ? "focal" : "focal_x", true, 1e-3, 1e3);
  const double fy = one_focal ? fx : number("focal_y", true, 1e-3, 1e3);
  const double cx = one_focal ? 0 : number("c_x", false, -1, 1), cy = one_focal ? 0 : number("c_y", false, -1, 1);
  double* c = lens->coefficients;
  c[0] = number("k1", false, -1e6, 1e6);
  if (model != "simple_radial") c[1] = number("k2", false, -1e6, 1e6);
  if (model == "brown") {
    c[2] = number("p1", false, -1e6, 1e6);
    c[3] = number("p2", false, -1e6, 1e6);
    c[4] = number("k3", false, -1e6, 1e6);
  }
  const double size = std::max(width, height);
  lens->pinhole = {static_cast<int>(width), static_cast<int>(height), fx * size, fy * size,
                   width / 2 + cx * size,   height / 2 + cy * size};
  using Kind = LensModel::Kind;
  lens->kind = c[4] != 0                ? Kind::kFullOpenCv
               : c[2] != 0 || c[3] != 0 ? Kind::kOpenCv
               : c[0] != 0 || c[1] != 0 ? Kind::kRadial
                                        : Kind::kPinhole;
  return good;
}

// One reconstruction on the way into a block.
struct SfmContext {
  const OpenSfmFiles& files;
  const Json& reconstruction;
  std::string location;  // "[0]"
  ImportedBlock& block;
  Faults& faults;
  Warnings& warnings;
  std::unordered_map<std::string_view, int> images = {}, points = {};  // by the keys in `reconstruction`

  void Fault(const std::string& at, const std::string& found, const std::string& expected) {
    faults.Add(InputError(files.path, absl::StrCat(location, at), found, expected));
  }
  const Json& Object(const char* key) {
    const Json& value = SfmMember(reconstruction, key);
    if (value.is_object() || value.is_null()) return value;
    Fault(absl::StrCat(".", key), SfmExcerpt(value), "an object");
    return kSfmNone;
  }
};

// The poses of shots that rigs give.
std::map<std::string, SfmPose> ReadSfmRigs(SfmContext& in) {
  std::map<std::string, SfmPose> poses;
  const Json& rig_cameras = in.Object("rig_cameras");
  for (const auto& [name, instance] : in.Object("rig_instances").items()) {
    const std::string at = absl::StrCat(".rig_instances[", Quoted(name), "]");
    const std::optional<SfmPose> of_instance = ReadSfmPose(instance);
    const Json& cameras = SfmMember(instance, "rig_camera_ids");
    if (!of_instance.has_value() || !cameras.is_object()) {
      in.Fault(at, SfmExcerpt(instance), "rotation, translation and rig_camera_ids");
      continue;
    }
    for (const auto& [shot, camera] : cameras.items()) {
      const std::string id = camera.is_string() ? camera.get<std::string>() : "";
      const std::optional<SfmPose> of_camera = ReadSfmPose(SfmMember(rig_cameras, id));
      if (of_camera.has_value()) {
        poses[shot] = {of_camera->R * of_instance->R, of_camera->R * of_instance->t + of_camera->t};
      } else {
        in.Fault(at, absl::StrCat("camera ", SfmExcerpt(camera)), "a camera of rig_cameras with a pose");
      }
    }
  }
  return poses;
}

void ReadSfmShots(SfmContext& in) {
  const std::map<std::string, SfmPose> rigs = ReadSfmRigs(in);
  const Json& cameras = in.Object("cameras");
  std::map<std::string, int> known;  // -1: with a fault
  size_t off_rig = 0;
  for (const auto& [name, shot] : in.Object("shots").items()) {
    const std::string at = absl::StrCat(".shots[", Quoted(name), "]");
    const Json& id = SfmMember(shot, "camera");
    const std::string camera_name = id.is_string() ? id.get<std::string>() : "";
    if (!SfmMember(cameras, camera_name).is_object()) {
      in.Fault(at + ".camera", SfmExcerpt(id), "a camera of this reconstruction");
      continue;
    }
    const auto [camera, is_new] = known.emplace(camera_name, -1);
    if (is_new) {
      BlockCamera read = {camera_name, {}};
      if (ReadSfmLens(cameras[camera_name], in.files.path,
                      absl::StrCat(in.location, ".cameras[", Quoted(camera_name), "]"), &read.lens, &in.faults)) {
        camera->second = static_cast<int>(in.block.cameras.size());
        in.block.cameras.push_back(read);
      }
    }
    if (name.empty()) in.Fault(at, "no name", "the name of the image's file");
    const auto rig = rigs.find(name);
    std::optional<SfmPose> pose = ReadSfmPose(shot);
    const bool has_own = shot.contains("rotation") || shot.contains("translation");
    if (!has_own && rig != rigs.end()) pose = rig->second;
    if (!pose.has_value()) {
      in.Fault(at, SfmExcerpt(shot), "rotation and translation, three numbers each");
      continue;
    }
    if (has_own && rig != rigs.end() &&
        ((pose->R - rig->second.R).norm() > 1e-3 || (pose->t - rig->second.t).norm() > 1e-3 * (1 + pose->t.norm())))
      ++off_rig;
    if (camera->second < 0) continue;
    BlockImage image;
    image.path = name;
    image.location = absl::StrCat("shot ", Quoted(name));
    image.camera = camera->second;
    image.rotation_cam_from_block = pose->R;
    image.centre = -pose->R.transpose() * pose->t;
    in.images[name] = static_cast<int>(in.block.images.size());
    in.block.images.push_back(image);
  }
  if (off_rig > 0) {
    in.warnings.push_back(absl::StrCat(in.files.path, ": ", off_rig,
                                       " shots have other poses than their rigs give; those of the shots are used"));
  }
}

void ReadSfmPoints(SfmContext& in) {
  for (const auto& [name, point] : in.Object("points").items()) {
    const std::optional<Vector3d> position = SfmVector(SfmMember(point, "coordinates"));
    if (!position.has_value()) {
      if (in.faults.messages().size() < kSfmMaxFaults)
        in.Fault(absl::StrCat(".points[", Quoted(name), "]"), SfmExcerpt(point), "coordinates, three numbers");
      continue;
    }
    in.points[name] = static_cast<int>(in.block.points.size());
    in.block.points.push_back({*position, {}});
  }
}

double SfmMedian(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

// The median distance in plan of the images' centres plus `offset` from their positions in shots.geojson; none without.
std::optional<double> DistanceFromSfmShots(const SfmContext& in, const Json& shots, const Vector2d& offset) {
  std::vector<double> distances;
  const Json& features = SfmMember(shots, "features");
  for (const Json& feature : features.is_array() ? features : Json::array()) {
    const Json& properties = SfmMember(feature, "properties");
    const Json& name = SfmMember(properties, "filename");
    const std::optional<Vector3d> position = SfmVector(SfmMember(properties, "translation"));
    const auto image = name.is_string() ? in.images.find(name.get_ref<const std::string&>()) : in.images.end();
    if (image == in.images.end() || !position.has_value()) continue;
    distances.push_back((position->head<2>() - in.block.images[image->second].centre.head<2>() - offset).norm());
  }
  if (distances.empty()) return std::nullopt;
  return SfmMedian(distances);
}

// Warns if the images lie beside their GPS positions, which are always topocentric: then the positions are not.
void CompareWithSfmGps(SfmContext& in) {
  std::vector<double> east, north, distances;
  for (const auto& [name, shot] : in.Object("shots").items()) {
    const std::optional<Vector3d> gps = SfmVector(SfmMember(shot, "gps_position"));
    const auto image = in.images.find(name);
    if (!gps.has_value() || image == in.images.end()) continue;
    const Vector3d difference = in.block.images[image->second].centre - *gps;
    east.push_back(difference.x());
    north.push_back(difference.y());
  }
  if (east.size() < 3) return;
  const Vector2d shift(SfmMedian(east), SfmMedian(north));
  for (size_t i = 0; i < east.size(); ++i) distances.push_back((Vector2d(east[i], north[i]) - shift).norm());
  if (shift.norm() < 10 || shift.norm() < 3 * SfmMedian(distances)) return;
  in.warnings.push_back(absl::StrFormat(
      "%s: the images lie %.0f m beside their GPS positions, all alike: if this is OpenDroneMap's projected "
      "reconstruction.json without its project folder, take reconstruction.topocentric.json or the whole folder",
      in.files.path, shift.norm()));
}

// The system and offset of projected positions; none if they are topocentric.
std::optional<OpenDroneMapGrid> ProjectedSfmGrid(SfmContext& in) {
  if (in.files.topocentric) return std::nullopt;
  std::vector<OpenDroneMapGrid> grids;
  for (const auto& [file, text] :
       {std::pair("coords.txt", in.files.coords), std::pair("odm_georeferencing_model_geo.txt", in.files.model_geo),
        std::pair("proj.txt", in.files.proj)}) {
    if (const std::optional<OpenDroneMapGrid> grid = ReadOpenDroneMapGrid(file, text, &in.faults))
      grids.push_back(*grid);
  }
  if (!grids.empty() && !in.files.shots.empty()) {
    const Json shots = ParseSfmJson("shots.geojson", in.files.shots, &in.faults);
    grids.push_back({grids[0].crs, Vector2d::Zero()});
    for (const OpenDroneMapGrid& grid : grids) {
      if (!grid.offset.has_value()) continue;
      const std::optional<double> distance = DistanceFromSfmShots(in, shots, *grid.offset);
      if (distance.has_value() && *distance < 0.1) return grid;
    }
    grids.pop_back();
  }
  if (!in.files.projected) return std::nullopt;
  for (const OpenDroneMapGrid& grid : grids) {
    if (grid.offset.has_value()) return grid;
  }
  in.faults.Add(InputError(in.files.path, "", "projected positions without their system and offset",
                           "odm_georeferencing/coords.txt in the project; or read reconstruction.topocentric.json"));
  return std::nullopt;
}

void SetSfmFrame(SfmContext& in) {
  if (const std::optional<OpenDroneMapGrid> grid = ProjectedSfmGrid(in)) {
    in.block.crs = grid->crs;
    in.block.offset = {grid->offset->x(), grid->offset->y(), 0};
    in.block.conventions.push_back(
        "Positions are projected, as shots.geojson or the reconstruction.topocentric.json beside them shows, less the "
        "offset of odm_georeferencing; OpenDroneMap turned the rotations into the grid.");
    return;
  }
  const Json& own = SfmMember(in.reconstruction, "reference_lla");
  const Json of_file =
      in.files.reference_lla.empty() ? Json() : ParseSfmJson("reference_lla.json", in.files.reference_lla, &in.faults);
  const Json& reference = own.is_object() ? own : of_file;
  if (!reference.is_object()) return;
  const std::optional<double> latitude = SfmNumber(SfmMember(reference, "latitude")),
                              longitude = SfmNumber(SfmMember(reference, "longitude")),
                              altitude = SfmNumber(SfmMember(reference, "altitude"));
  if (!latitude || !longitude || !altitude || std::abs(*latitude) > 90 || std::abs(*longitude) > 180) {
    in.Fault(".reference_lla", SfmExcerpt(reference), "latitude, longitude (degrees) and altitude (metres)");
    return;
  }
  if (own.is_object() && of_file.is_object() && own != of_file) {
    in.warnings.push_back(absl::StrCat(in.files.path, ": its reference_lla ", SfmExcerpt(own), " is used; that of ",
                                       "reference_lla.json differs: ", SfmExcerpt(of_file)));
  }
  if (*latitude == 0 && *longitude == 0) {  // OpenSfM writes this for images without GPS
    in.block.conventions.push_back("The reference is latitude 0, longitude 0: images without GPS, in a local frame.");
    return;
  }
  in.block.crs = absl::StrFormat("ENU:%.12f,%.12f,%.9g", *latitude, *longitude, *altitude);
  in.block.conventions.push_back(
      "Positions are east, north and up of reference_lla; heights are above what those of the images' GPS or of the "
      "control points are.");
  if (!in.files.topocentric) CompareWithSfmGps(in);
}

}  // namespace

ImportedBlock ParseOpenSfm(const OpenSfmFiles& files, const BlockReadOptions& options, Faults* faults,
                           Warnings* warnings) {
  ImportedBlock block;
  const size_t faults_before = faults->messages().size();
  const Json root = ParseSfmJson(files.path, files.reconstructions, faults);
  if (faults->messages().size() > faults_before) return block;
  if (!root.is_array() || root.empty()) {
    faults->Add(InputError(files.path, "", SfmExcerpt(root), "a list of reconstructions"));
    return block;
  }
  const auto shots_of = [&](size_t i) { return SfmMember(root[i], "shots").size(); };
  size_t chosen = 0;
  for (size_t i = 1; i < root.size(); ++i) chosen = shots_of(i) > shots_of(chosen) ? i : chosen;
  if (options.component >= 0) chosen = static_cast<size_t>(options.component);
  if (chosen >= root.size()) {
    faults->Add(InputError("--component", "", absl::StrCat(options.component), absl::StrCat("0 to ", root.size() - 1)));
    return block;
  }
  for (size_t i = 0; i < root.size(); ++i) {
    if (i != chosen) block.left_out.push_back(absl::StrCat("component ", i, ": ", shots_of(i), " images"));
  }
  SfmContext in{files, root[chosen], absl::StrCat("[", chosen, "]"), block, *faults, *warnings};
  block.conventions = {
      "A rotation vector takes the world to the camera; the translation is that of the camera's coordinates.",
      "Image coordinates are shares of the longer side from the middle of the image; p1 and p2 in OpenCV's order."};
  ReadSfmShots(in);
  ReadSfmPoints(in);
  for (BlockImage& image : block.images) image.component = static_cast<int>(chosen);
  if (block.images.empty() && faults->messages().size() == faults_before)
    in.Fault(".shots", "no images", "a reconstruction with images");
  if (!files.tracks.empty()) ReadOpenSfmTracks(files.tracks, in.images, in.points, &block, faults);
  if (const size_t panoramas = SfmMember(in.reconstruction, "pano_shots").size(); panoramas > 0)
    block.left_out.push_back(absl::StrCat(panoramas, " panoramas"));
  const size_t points = block.points.size();
  std::erase_if(block.points, [](const BlockTiePoint& point) { return point.observations.size() < 2; });
  if (block.points.size() < points) {
    block.left_out.push_back(absl::StrCat(points - block.points.size(), " points without two observations",
                                          files.tracks.empty() ? ": there is no tracks.csv" : " in tracks.csv"));
  }
  SetSfmFrame(in);
  return block;
}

}  // namespace tessera
