// COLMAP text models and scene.json of a test's scene, to be edited. All functions abort the test on errors.
#pragma once

#include <Eigen/Geometry>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tessera::bent {

struct TextCamera {
  int id = 0;
  std::string model;
  int width = 0, height = 0;
  std::vector<double> parameters;
};

struct TextImage {
  int id = 0;
  Eigen::Quaterniond rotation;  // camera from world, as in the file
  Eigen::Vector3d translation;
  int camera = 0;
  std::string name;
  std::string points;  // the line of image points

  std::string Stem() const;  // the name without its extension
};

// Of the model in `scene`/colmap.
std::vector<TextCamera> ReadTextCameras(const std::string& scene);
std::vector<TextImage> ReadTextImages(const std::string& scene);
void WriteTextCameras(const std::string& scene, const std::vector<TextCamera>& cameras);
void WriteTextImages(const std::string& scene, const std::vector<TextImage>& images);

// The first line of an image as in images.txt, without line end.
std::string PoseLine(const TextImage& image);

// Writes the images without image points, and removes points3D.txt.
void WriteImagesWithoutPoints(const std::string& scene, std::vector<TextImage> images);

// Writes cameras.bin, images.bin and points3D.bin, without points. `model_ids`: COLMAP's id of each camera's model.
void WriteBinaryModel(const std::string& scene, const std::vector<TextCamera>& cameras,
                      const std::vector<int>& model_ids, const std::vector<TextImage>& images);

// Sets a key of scene.json; null removes it.
void SetInSceneJson(const std::string& scene, const std::string& key, const nlohmann::json& value);

// Moves cameras, 3D points and mesh to scale * rotation * X + offset.
void TransformScene(const std::string& scene, const Eigen::Matrix3d& rotation, const Eigen::Vector3d& offset,
                    double scale = 1);

// Renames an image, with its likelihoods.
void RenameImage(const std::string& scene, TextImage* image, const std::string& name);

// Aborts the test.
[[noreturn]] void FailBend(const std::string& message);

}  // namespace tessera::bent
