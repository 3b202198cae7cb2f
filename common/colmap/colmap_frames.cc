#include "common/colmap/colmap_frames.h"

#include <Eigen/Geometry>
#include <cmath>
#include <unordered_map>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/colmap/colmap_bytes.h"
#include "common/colmap/colmap_lines.h"

namespace tessera {
namespace {

constexpr int32_t kCameraSensor = 0;  // in binary files; in text files CAMERA

bool MakePose(const double (&qt)[7], RigidPose* pose) {
  const Eigen::Quaterniond quaternion(qt[0], qt[1], qt[2], qt[3]);
  const double norm = quaternion.norm();
  pose->translation = Eigen::Vector3d(qt[4], qt[5], qt[6]);
  if (!std::isfinite(norm) || norm < 1e-6 || !pose->translation.allFinite()) return false;
  pose->rotation = quaternion.normalized().toRotationMatrix();
  return true;
}

bool ReadPose(ColmapLineReader& lines, RigidPose* pose) {
  double qt[7];
  for (double& value : qt) {
    if (!lines.Number(&value)) return false;
  }
  return MakePose(qt, pose);
}

bool ReadPose(ColmapByteReader& in, RigidPose* pose) {
  double qt[7];
  for (double& value : qt) value = in.Read<double>();
  return in.ok() && MakePose(qt, pose);
}

// RIG_ID NUM_SENSORS REF_SENSOR_TYPE REF_SENSOR_ID (SENSOR_TYPE SENSOR_ID HAS_POSE [QW QX QY QZ TX TY TZ])...
bool ReadRig(ColmapLineReader& lines, ColmapFrames* out) {
  uint32_t rig = 0, sensors = 0, id = 0;
  if (!lines.Number(&rig) || !lines.Number(&sensors)) return false;
  for (uint32_t k = 0; k < sensors; ++k) {
    const bool is_camera = lines.Word() == "CAMERA";
    int has_pose = 1;
    RigidPose cam_from_rig;  // the first sensor's is the identity
    if (!lines.Number(&id) || (k > 0 && !lines.Number(&has_pose))) return false;
    if (k > 0 && has_pose != 0 && !ReadPose(lines, &cam_from_rig)) return false;
    if (is_camera && has_pose != 0) out->cam_from_rig.emplace(std::pair(rig, id), cam_from_rig);
  }
  return lines.AtEnd();
}

// FRAME_ID RIG_ID QW QX QY QZ TX TY TZ NUM_DATA_IDS (SENSOR_TYPE SENSOR_ID DATA_ID)...
bool ReadFrame(ColmapLineReader& lines, ColmapFrames* out) {
  uint32_t frame = 0, data = 0;
  ColmapFrames::Image image;
  if (!lines.Number(&frame) || !lines.Number(&image.rig_id) || !ReadPose(lines, &image.rig_from_world) ||
      !lines.Number(&data)) {
    return false;
  }
  for (uint32_t k = 0; k < data; ++k) {
    const bool is_camera = lines.Word() == "CAMERA";
    if (!lines.Number(&image.camera_id) || !lines.Number(&image.image_id)) return false;
    if (is_camera) out->images.push_back(image);
  }
  return lines.AtEnd();
}

bool ReadRig(ColmapByteReader& in, ColmapFrames* out) {
  const auto rig = in.Read<uint32_t>(), sensors = in.Read<uint32_t>();
  for (uint32_t k = 0; k < sensors && in.ok(); ++k) {
    const bool is_camera = in.Read<int32_t>() == kCameraSensor;
    const auto id = in.Read<uint32_t>();
    RigidPose cam_from_rig;
    const bool has_pose = k == 0 || in.Read<uint8_t>() != 0;
    if (k > 0 && has_pose && !ReadPose(in, &cam_from_rig)) return false;
    if (is_camera && has_pose && in.ok()) out->cam_from_rig.emplace(std::pair(rig, id), cam_from_rig);
  }
  return in.ok();
}

bool ReadFrame(ColmapByteReader& in, ColmapFrames* out) {
  in.Read<uint32_t>();  // id
  ColmapFrames::Image image;
  image.rig_id = in.Read<uint32_t>();
  if (!ReadPose(in, &image.rig_from_world)) return false;
  const auto data = in.Read<uint32_t>();
  for (uint32_t k = 0; k < data && in.ok(); ++k) {
    const bool is_camera = in.Read<int32_t>() == kCameraSensor;
    image.camera_id = in.Read<uint32_t>();
    image.image_id = in.Read<uint64_t>();
    if (is_camera && in.ok()) out->images.push_back(image);
  }
  return in.ok();
}

std::string CentreText(const RigidPose& pose) {
  const Eigen::Vector3d centre = pose.Centre();
  return absl::StrFormat("(%.3f, %.3f, %.3f)", centre.x(), centre.y(), centre.z());
}

}  // namespace

ColmapFrames ParseColmapFramesText(const std::string& rigs, const std::string& frames, const std::string& folder,
                                   Faults* faults) {
  ColmapFrames out;
  for (ColmapLineReader lines(rigs, folder + "/rigs.txt"); lines.NextEntry();) {
    if (ReadRig(lines, &out)) continue;
    faults->Add(lines.Location().Error(
        lines.Peek(), "RIG_ID NUM_SENSORS REF_SENSOR_TYPE REF_SENSOR_ID (SENSOR_TYPE SENSOR_ID HAS_POSE [POSE])..."));
  }
  for (ColmapLineReader lines(frames, folder + "/frames.txt"); lines.NextEntry();) {
    if (ReadFrame(lines, &out)) continue;
    faults->Add(
        lines.Location().Error(lines.Peek(), "FRAME_ID RIG_ID POSE NUM_DATA_IDS (SENSOR_TYPE SENSOR_ID DATA_ID)..."));
  }
  return out;
}

ColmapFrames ParseColmapFramesBinary(const std::string& rigs, const std::string& frames, const std::string& folder,
                                     Faults* faults) {
  ColmapFrames out;
  const auto read = [&](const std::string& bytes, const char* name, const char* what, uint64_t smallest_bytes,
                        bool (*read_entry)(ColmapByteReader&, ColmapFrames*)) {
    ColmapByteReader in(bytes, folder + name);
    uint64_t count = 0;
    if (!in.Count(smallest_bytes, &count, faults)) return;
    for (uint64_t i = 0; i < count; ++i) {
      const ColmapLocation location = in.Location();
      if (read_entry(in, &out)) continue;
      return in.ok() ? faults->Add(location.Error("a pose that is not finite", "a pose"))
                     : in.Truncated(i, count, what, faults);
    }
    in.CheckEnd(faults);
  };
  read(rigs, "/rigs.bin", "rig", 4 + 4, ReadRig);
  read(frames, "/frames.bin", "frame", 4 + 4 + 7 * 8 + 4, ReadFrame);
  return out;
}

void CompareWithFrames(const CalibratedImages& model, const ColmapFrames& frames, const std::string& folder,
                       const std::string& extension, Faults* faults) {
  std::unordered_map<uint64_t, const CalibratedImage*> images;
  for (const CalibratedImage& image : model.images) images.emplace(image.id, &image);
  const CalibratedImage* worst = nullptr;
  RigidPose worst_of_frame;
  PoseDifference largest;
  int64_t compared = 0, different = 0;
  for (const ColmapFrames::Image& in_frame : frames.images) {
    const auto image = images.find(in_frame.image_id);
    const auto cam_from_rig = frames.cam_from_rig.find({in_frame.rig_id, in_frame.camera_id});
    if (image == images.end() || cam_from_rig == frames.cam_from_rig.end()) continue;
    const RigidPose of_frame = Chain(cam_from_rig->second, in_frame.rig_from_world);
    const PoseDifference difference = ComparePoses(PoseOf(*image->second), of_frame);
    ++compared;
    if (!difference.exceeds_rounding) continue;
    ++different;
    if (worst != nullptr && difference.centre_m <= largest.centre_m) continue;
    worst = image->second;
    worst_of_frame = of_frame;
    largest = difference;
  }
  if (worst == nullptr) return;
  faults->Add(InputError(
      absl::StrCat(folder, "/images", extension), absl::StrCat("image '", worst->name, "'"),
      absl::StrCat("a camera centre of ", CentreText(PoseOf(*worst))),
      absl::StrCat(CentreText(worst_of_frame), " as in frames", extension, ", ",
                   DistanceText(largest.centre_m, largest.angle_rad), " from it (", different, " of ", compared,
                   " images differ): one of the files is out of date; export the model again, or delete frames",
                   extension, " and rigs", extension, " if the poses of images", extension, " are right")));
}

}  // namespace tessera
