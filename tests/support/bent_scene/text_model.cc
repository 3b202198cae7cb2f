#include "tests/support/bent_scene/text_model.h"

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <sstream>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "common/meshio/ply.h"
#include "tests/support/bent_scene/raw_bytes.h"
#include "tests/support/tiny_scene.h"

namespace tessera::bent {
namespace {

namespace fs = std::filesystem;

// The lines of a text file without comments. Empty lines stay.
std::vector<std::string> DataLines(const std::string& path) {
  std::vector<std::string> lines;
  std::istringstream text(ReadText(path));
  for (std::string line; std::getline(text, line);) {
    if (!line.starts_with('#')) lines.push_back(line);
  }
  return lines;
}

}  // namespace

void FailBend(const std::string& message) {
  std::fprintf(stderr, "cannot bend the scene: %s\n", message.c_str());
  std::abort();
}

std::string TextImage::Stem() const { return fs::path(name).replace_extension().string(); }

std::vector<TextCamera> ReadTextCameras(const std::string& scene) {
  std::vector<TextCamera> cameras;
  for (const std::string& line : DataLines(scene + "/colmap/cameras.txt")) {
    std::istringstream words(line);
    TextCamera camera;
    words >> camera.id >> camera.model >> camera.width >> camera.height;
    for (double value; words >> value;) camera.parameters.push_back(value);
    cameras.push_back(camera);
  }
  return cameras;
}

std::vector<TextImage> ReadTextImages(const std::string& scene) {
  std::vector<TextImage> images;
  const std::vector<std::string> lines = DataLines(scene + "/colmap/images.txt");
  for (size_t i = 0; i + 1 < lines.size(); i += 2) {
    std::istringstream words(lines[i]);
    TextImage image;
    words >> image.id >> image.rotation.w() >> image.rotation.x() >> image.rotation.y() >> image.rotation.z() >>
        image.translation.x() >> image.translation.y() >> image.translation.z() >> image.camera >> image.name;
    if (!words) FailBend("line of images.txt: " + lines[i]);
    image.points = lines[i + 1];
    images.push_back(image);
  }
  if (images.empty()) FailBend("no image");
  return images;
}

void WriteTextCameras(const std::string& scene, const std::vector<TextCamera>& cameras) {
  std::string text = "# cameras\n";
  for (const TextCamera& camera : cameras) {
    absl::StrAppend(&text, camera.id, " ", camera.model, " ", camera.width, " ", camera.height);
    for (const double value : camera.parameters) absl::StrAppendFormat(&text, " %.17g", value);
    text += "\n";
  }
  WriteText(scene + "/colmap/cameras.txt", text);
}

std::string PoseLine(const TextImage& image) {
  const Eigen::Quaterniond& q = image.rotation;
  const Eigen::Vector3d& t = image.translation;
  return absl::StrFormat("%d %.17g %.17g %.17g %.17g %.17g %.17g %.17g %d %s", image.id, q.w(), q.x(), q.y(), q.z(),
                         t.x(), t.y(), t.z(), image.camera, image.name);
}

void WriteTextImages(const std::string& scene, const std::vector<TextImage>& images) {
  std::string text = "# images\n";
  for (const TextImage& image : images) absl::StrAppend(&text, PoseLine(image), "\n", image.points, "\n");
  WriteText(scene + "/colmap/images.txt", text);
}

void WriteImagesWithoutPoints(const std::string& scene, std::vector<TextImage> images) {
  for (TextImage& image : images) image.points.clear();
  WriteTextImages(scene, images);
  fs::remove(scene + "/colmap/points3D.txt");
}

void WriteBinaryModel(const std::string& scene, const std::vector<TextCamera>& cameras,
                      const std::vector<int>& model_ids, const std::vector<TextImage>& images) {
  std::string bytes = Raw<uint64_t>({cameras.size()});
  for (size_t i = 0; i < cameras.size(); ++i) {
    const TextCamera& camera = cameras[i];
    bytes += Raw<int32_t>({camera.id, model_ids.at(i)});
    bytes += Raw<uint64_t>({static_cast<uint64_t>(camera.width), static_cast<uint64_t>(camera.height)});
    bytes += Raw<double>(camera.parameters);
  }
  WriteText(scene + "/colmap/cameras.bin", bytes);
  bytes = Raw<uint64_t>({images.size()});
  for (const TextImage& image : images) {
    const Eigen::Quaterniond& q = image.rotation;
    const Eigen::Vector3d& t = image.translation;
    bytes += Raw<int32_t>({image.id}) + Raw<double>({q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()});
    bytes += Raw<int32_t>({image.camera}) + image.name + '\0' + Raw<uint64_t>({0});
  }
  WriteText(scene + "/colmap/images.bin", bytes);
  WriteText(scene + "/colmap/points3D.bin", Raw<uint64_t>({0}));
}

void SetInSceneJson(const std::string& scene, const std::string& key, const nlohmann::json& value) {
  nlohmann::ordered_json json = nlohmann::ordered_json::parse(ReadText(scene + "/scene.json"));
  if (value.is_null()) {
    json.erase(key);
  } else {
    json[key] = value;
  }
  WriteText(scene + "/scene.json", json.dump(1) + "\n");
}

void TransformScene(const std::string& scene, const Eigen::Matrix3d& rotation, const Eigen::Vector3d& offset,
                    double scale) {
  StatusOr<MeshContent> content = ReadPly(scene + "/mesh.ply");
  if (!content.ok()) FailBend(std::string(content.status().message()));
  for (Eigen::Vector3d& p : content->mesh.vertices) p = scale * rotation * p + offset;
  if (!WritePly(scene + "/mesh.ply", content->mesh).ok()) FailBend("cannot write the mesh");
  std::vector<TextImage> images = ReadTextImages(scene);
  for (TextImage& image : images) {
    const Eigen::Matrix3d turned = image.rotation.normalized().toRotationMatrix() * rotation.transpose();
    image.translation = scale * image.translation - turned * offset;
    image.rotation = Eigen::Quaterniond(turned);
  }
  WriteTextImages(scene, images);
  std::string points;
  for (const std::string& line : DataLines(scene + "/colmap/points3D.txt")) {
    std::vector<std::string> words = absl::StrSplit(line, ' ');
    Eigen::Vector3d p;
    for (int k = 0; k < 3; ++k) p[k] = std::stod(words.at(k + 1));
    p = scale * rotation * p + offset;
    for (int k = 0; k < 3; ++k) words[k + 1] = absl::StrFormat("%.17g", p[k]);
    for (const std::string& word : words) absl::StrAppend(&points, word, &word == &words.back() ? "\n" : " ");
  }
  WriteText(scene + "/colmap/points3D.txt", points);
}

void RenameImage(const std::string& scene, TextImage* image, const std::string& name) {
  const std::string old_name = image->name, old_stem = image->Stem();
  image->name = name;
  for (const char* folder : {"/images/", "/likelihoods/"}) {
    fs::create_directories(fs::path(scene + folder + name).parent_path());
  }
  fs::rename(scene + "/images/" + old_name, scene + "/images/" + name);
  fs::rename(scene + "/likelihoods/" + old_stem + ".tif", scene + "/likelihoods/" + image->Stem() + ".tif");
}

}  // namespace tessera::bent
