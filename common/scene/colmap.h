// COLMAP sparse models, text and binary: https://colmap.github.io/format.html
#ifndef TESSERA_COMMON_SCENE_COLMAP_H_
#define TESSERA_COMMON_SCENE_COLMAP_H_

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/camera.h"
#include "common/storage/allowed_files.h"

namespace tessera {

// An image point with its 3D point.
struct ColmapObservation {
  Eigen::Vector2d position_px;  // in the distorted photograph
  uint64_t point_id = 0;
};

struct ColmapImage {
  uint32_t id = 0;
  std::string name;  // relative to the images folder
  uint32_t camera_id = 0;
  Eigen::Matrix3d rotation_cam_from_world = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation_cam_from_world = Eigen::Vector3d::Zero();
  std::vector<ColmapObservation> observations;  // only image points with a 3D point
};

struct ColmapPoint {
  uint64_t id = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  std::vector<uint32_t> image_ids;  // the images of its track
};

struct ColmapModel {
  std::map<uint32_t, LensModel> cameras;
  std::vector<ColmapImage> images;  // by ascending id
  std::vector<ColmapPoint> points;  // empty if the model has none or they were not requested
  bool binary = false;
};

enum class ColmapContent { kCameras, kCamerasAndPoints };  // the second adds image points and 3D points

// Reads the model in `folder`: cameras.bin and images.bin, else cameras.txt and images.txt, and points3D.* if it exists
// and is requested. Camera models: SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV; a camera with
// only zero coefficients becomes a pinhole. Quaternions are normalised. Invalid entries are omitted and reported to
// `faults` with file and line (text) or byte offset (binary). Allocates at most a small multiple of the files' sizes.
ColmapModel ReadColmapModel(const std::string& folder, ColmapContent content, Faults* faults,
                            const AllowedFiles& allowed = AllowedFiles::All());

// The same from the contents of the three files, for tests and fuzzing. `folder` is the path in messages. Entries are
// added to `model`.
void ParseColmapText(const std::string& cameras, const std::string& images, const std::string& points,
                     const std::string& folder, ColmapContent content, ColmapModel* model, Faults* faults);
void ParseColmapBinary(const std::string& cameras, const std::string& images, const std::string& points,
                       const std::string& folder, ColmapContent content, ColmapModel* model, Faults* faults);

}  // namespace tessera

#endif  // TESSERA_COMMON_SCENE_COLMAP_H_
