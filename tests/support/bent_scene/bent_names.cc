// Files and names of the model and of its images.
#include <algorithm>
#include <filesystem>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "common/imaging/image_io.h"
#include "tests/support/bent_scene/bent_scene.h"
#include "tests/support/bent_scene/text_model.h"
#include "tests/support/tiny_scene.h"

namespace tessera::bent {
namespace {

namespace fs = std::filesystem;

constexpr const char* kModelFiles[] = {"cameras.txt", "images.txt", "points3D.txt"};

// A number as Microsoft's library prints it: with three digits of the exponent.
std::string LongExponent(double value) {
  const std::string text = absl::StrFormat("%.15e", value);
  const size_t sign_end = text.size() - 2;
  return absl::StrCat(text.substr(0, sign_end), "0", text.substr(sign_end));
}

}  // namespace

void NoPointsLines(const std::string& scene) {
  std::string text = "# images\n";
  for (const TextImage& image : ReadTextImages(scene)) absl::StrAppend(&text, PoseLine(image), "\n");
  WriteText(scene + "/colmap/images.txt", text);
  fs::remove(scene + "/colmap/points3D.txt");
}

void GapInImagePoints(const std::string& scene) {
  std::vector<TextImage> images = ReadTextImages(scene);
  for (const size_t i : {2, 5}) images.at(i).points.clear();
  images.back().points.clear();
  WriteTextImages(scene, images);
  std::string text = ReadText(scene + "/colmap/images.txt");
  text.resize(text.size() - 2);  // without the last line, and without the end of the line before it
  WriteText(scene + "/colmap/images.txt", text);
}

void RealityScanText(const std::string& scene) {
  std::vector<TextImage> images = ReadTextImages(scene);
  std::string text = absl::StrCat("# Image list\n#   IMAGE_ID, ...\n# Number of images: ", images.size(), "\n");
  for (TextImage& image : images) {
    RenameImage(scene, &image, absl::StrCat("flight A/A-DJI 2024.10.16 (", image.id, ") map-plan.JPG"));
    absl::StrAppend(&text, image.id);
    const Eigen::Quaterniond& q = image.rotation;
    const Eigen::Vector3d& t = image.translation;
    for (const double value : {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()}) {
      absl::StrAppend(&text, " ", LongExponent(value));
    }
    absl::StrAppend(&text, " ", image.camera, " ", image.name, "\n", image.points, " \n");
  }
  WriteText(scene + "/colmap/images.txt", text);
  for (const char* name : kModelFiles) {
    const std::string path = absl::StrCat(scene, "/colmap/", name);
    WriteText(path, absl::StrReplaceAll(ReadText(path), {{"\n", "\r\n"}}));
  }
}

void SubModels(const std::string& scene) {
  const std::string colmap = scene + "/colmap/";
  for (const char* folder : {"0/", "1/"}) fs::create_directory(colmap + folder);
  for (const char* name : kModelFiles) {
    fs::copy(colmap + name, colmap + "1/" + name);
    fs::rename(colmap + name, colmap + "0/" + name);
  }
}

void Backslashes(const std::string& scene) {
  std::vector<TextImage> images = ReadTextImages(scene);
  for (TextImage& image : images) {
    RenameImage(scene, &image, "north/" + image.name);
    image.name[5] = '\\';
  }
  WriteTextImages(scene, images);
}

void CaseOfExtension(const std::string& scene) {
  for (const TextImage& image : ReadTextImages(scene)) {
    const std::string old_path = scene + "/images/" + image.name;
    fs::rename(old_path, scene + "/images/" + image.Stem() + ".JPG");
  }
}

void OneImageMissing(const std::string& scene) {
  const std::string path = scene + "/images/south_00_000.jpg";
  if (!fs::remove(path)) FailBend("no " + path);
}

void NonAsciiNames(const std::string& scene) {
  std::vector<TextImage> images = ReadTextImages(scene);
  for (TextImage& image : images) RenameImage(scene, &image, "Stra\u00dfe_\u00e9" + image.name);
  WriteTextImages(scene, images);
}

void NamesWithDotSlash(const std::string& scene) {
  std::vector<TextImage> images = ReadTextImages(scene);
  for (TextImage& image : images) image.name = "./" + image.name;
  WriteTextImages(scene, images);
}

void ByteOrderMark(const std::string& scene) {
  for (const char* name : {"colmap/cameras.txt", "colmap/images.txt", "colmap/points3D.txt", "scene.json"}) {
    const std::string path = absl::StrCat(scene, "/", name);
    WriteText(path, "\xef\xbb\xbf" + ReadText(path));
  }
}

void LfsPointers(const std::string& scene) {
  const std::string pointer =
      "version https://git-lfs.github.com/spec/v1\n"
      "oid sha256:4d7a214614ab2935c943f9e0ff69d22eadbb8f32b1258daaa5e2ca24d17e2393\nsize 12345678\n";
  for (const char* name : {"mesh.ply", "colmap/cameras.bin", "colmap/images.bin", "images/nadir_00_000.jpg"}) {
    WriteText(absl::StrCat(scene, "/", name), pointer);
  }
}

void JpgAndPngOfOneStem(const std::string& scene) {
  std::vector<TextImage> images = ReadTextImages(scene);
  for (TextImage& image : images) {
    if (image.name != "west_00_000.jpg") continue;
    const auto pixels = ReadRgb(scene + "/images/" + image.name);
    image.name = "east_00_000.png";
    if (!pixels.ok() || !WritePng(scene + "/images/" + image.name, *pixels).ok()) FailBend(image.name);
  }
  WriteTextImages(scene, images);
}

void ManyMissing(const std::string& scene) {
  const std::vector<TextImage> images = ReadTextImages(scene);
  std::vector<TextImage> many;
  for (int i = 0; i < 600; ++i) {
    TextImage image = images[i % images.size()];
    image.id = i + 1;
    image.name = absl::StrFormat("block_a/strip_%02d/DJI_%05d_a_rather_long_name_of_a_flight.JPG", i / 30, i);
    many.push_back(image);
  }
  WriteImagesWithoutPoints(scene, many);
  for (const char* folder : {"/images", "/likelihoods"}) fs::remove_all(scene + folder);
  fs::create_directory(scene + "/images");
  SetInSceneJson(scene, "likelihoods", nullptr);
}

void SamePhotoTwice(const std::string& scene) {
  std::vector<TextImage> images = ReadTextImages(scene);
  const size_t originals = images.size();
  for (size_t i = 0; i < originals; ++i) {
    TextImage copy = images[i];
    copy.id += 100;
    copy.name = "copy_" + copy.name;
    fs::copy(scene + "/images/" + images[i].name, scene + "/images/" + copy.name);
    fs::copy(scene + "/likelihoods/" + images[i].Stem() + ".tif", scene + "/likelihoods/" + copy.Stem() + ".tif");
    images.push_back(copy);
  }
  WriteImagesWithoutPoints(scene, images);
}

}  // namespace tessera::bent
