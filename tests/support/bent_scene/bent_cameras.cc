// Poses and camera models.
#include <filesystem>
#include <random>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "tests/support/bent_scene/bent_scene.h"
#include "tests/support/bent_scene/text_model.h"
#include "tests/support/tiny_scene.h"

namespace tessera::bent {
namespace {

namespace fs = std::filesystem;

// Edits the pose of each image, and drops the points, which would no longer fit.
template <class Edit>
void EditPoses(const std::string& scene, const Edit& edit) {
  std::vector<TextImage> images = ReadTextImages(scene);
  for (TextImage& image : images) edit(&image.rotation, &image.translation);
  WriteImagesWithoutPoints(scene, images);
}

// Keeps only the images with these stems.
void KeepImages(const std::string& scene, const std::vector<std::string>& stems) {
  std::vector<TextImage> images = ReadTextImages(scene);
  std::erase_if(images, [&](const TextImage& image) {
    return std::find(stems.begin(), stems.end(), image.Stem()) == stems.end();
  });
  if (images.size() != stems.size()) FailBend("an image to keep is missing");
  WriteImagesWithoutPoints(scene, images);
}

}  // namespace

void NanIndCamera(const std::string& scene) {
  const std::string path = scene + "/colmap/cameras.txt";
  WriteText(path, ReadText(path) + "77 SIMPLE_RADIAL 400 300 -nan(ind) 200 150 -nan(ind)\n");
}

void FiveParameters(const std::string& scene) {
  std::vector<TextCamera> cameras = ReadTextCameras(scene);
  for (TextCamera& camera : cameras) {
    camera.model = "SIMPLE_RADIAL";
    camera.parameters = {camera.parameters[0], camera.parameters[2], camera.parameters[3], 0.001, 0};
  }
  WriteTextCameras(scene, cameras);
}

void FisheyeText(const std::string& scene) {
  std::vector<TextCamera> cameras = ReadTextCameras(scene);
  cameras.at(0).model = "OPENCV_FISHEYE";
  cameras.at(0).parameters.insert(cameras[0].parameters.end(), {0.01, 0, 0, 0});
  cameras.at(1).model = "EUCM";
  cameras.at(1).parameters.insert(cameras[1].parameters.end(), {0.6, 1});
  WriteTextCameras(scene, cameras);
}

void FisheyeBinary(const std::string& scene) {
  constexpr int kPinhole = 1, kRadTanThinPrismFisheye = 11;
  std::vector<TextCamera> cameras = ReadTextCameras(scene);
  cameras.at(0).parameters.resize(16, 0.0);
  std::vector<int> models(cameras.size(), kPinhole);
  models[0] = kRadTanThinPrismFisheye;
  WriteBinaryModel(scene, cameras, models, ReadTextImages(scene));
  for (const char* name : {"cameras.txt", "images.txt", "points3D.txt"}) fs::remove(scene + "/colmap/" + name);
}

void CameraToWorld(const std::string& scene) {
  EditPoses(scene, [](Eigen::Quaterniond* q, Eigen::Vector3d* t) {
    *q = q->conjugate();
    *t = -(*q * *t);
  });
}

void QuaternionXyzw(const std::string& scene) {
  EditPoses(scene, [](Eigen::Quaterniond* q, Eigen::Vector3d*) {
    *q = Eigen::Quaterniond(q->x(), q->y(), q->z(), q->w());  // the file's four numbers
  });
}

void OpenGlCameras(const std::string& scene) {
  const Eigen::Quaterniond half_turn_about_x(0, 1, 0, 0);
  EditPoses(scene, [&](Eigen::Quaterniond* q, Eigen::Vector3d* t) {
    *q = half_turn_about_x * *q;
    *t = half_turn_about_x * *t;
  });
}

void StaleRigPoses(const std::string& scene) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> offset_m(-1.5, 1.5);
  std::vector<TextImage> images = ReadTextImages(scene);
  std::string frames = "# FRAME_ID RIG_ID RIG_FROM_WORLD NUM_DATA_IDS (SENSOR_TYPE SENSOR_ID DATA_ID)\n";
  for (size_t i = 0; i < images.size(); ++i) {
    const Eigen::Quaterniond& q = images[i].rotation;
    Eigen::Vector3d& t = images[i].translation;
    absl::StrAppendFormat(&frames, "%d %d %.17g %.17g %.17g %.17g %.17g %.17g %.17g 1 CAMERA %d %d\n", images[i].id,
                          images[i].camera, q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z(), images[i].camera,
                          images[i].id);
    if (i % 5 == 0) t += Eigen::Vector3d(offset_m(random), offset_m(random), offset_m(random));
  }
  WriteTextImages(scene, images);
  WriteText(scene + "/colmap/frames.txt", frames);
  std::string rigs = "# RIG_ID NUM_SENSORS REF_SENSOR_TYPE REF_SENSOR_ID\n";
  for (const TextCamera& camera : ReadTextCameras(scene)) {
    absl::StrAppend(&rigs, camera.id, " 1 CAMERA ", camera.id, "\n");
  }
  WriteText(scene + "/colmap/rigs.txt", rigs);
}

void OldBinaryBesideText(const std::string& scene) {
  std::vector<TextImage> images = ReadTextImages(scene);
  for (TextImage& image : images) {
    image.translation -= image.rotation.normalized() * Eigen::Vector3d(0, 0, 10);
  }
  const std::vector<TextCamera> cameras = ReadTextCameras(scene);
  WriteBinaryModel(scene, cameras, std::vector<int>(cameras.size(), 1), images);
  const auto edited = fs::last_write_time(scene + "/colmap/images.txt");
  for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"}) {
    fs::last_write_time(scene + "/colmap/" + name, edited - std::chrono::hours(24));
  }
}

void PrincipalPointAtZero(const std::string& scene) {
  std::vector<TextCamera> cameras = ReadTextCameras(scene);
  for (TextCamera& camera : cameras) camera.parameters.at(2) = camera.parameters.at(3) = 0;
  WriteTextCameras(scene, cameras);
  WriteImagesWithoutPoints(scene, ReadTextImages(scene));
}

void OneImage(const std::string& scene) { KeepImages(scene, {"nadir_00_001"}); }

void TwoImages(const std::string& scene) { KeepImages(scene, {"nadir_00_001", "nadir_00_002"}); }

}  // namespace tessera::bent
