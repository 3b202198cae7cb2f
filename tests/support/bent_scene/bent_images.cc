// Photographs.
#include <cmath>
#include <filesystem>
#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "common/imaging/image_io.h"
#include "tests/support/bent_scene/bent_scene.h"
#include "tests/support/bent_scene/picture_files.h"
#include "tests/support/bent_scene/text_model.h"
#include "tests/support/tiny_scene.h"

namespace tessera::bent {
namespace {

namespace fs = std::filesystem;

std::string ImagePath(const std::string& scene, size_t index) {
  return scene + "/images/" + ReadTextImages(scene).at(index).name;
}

ByteImage Photograph(const std::string& path) {
  auto pixels = ReadRgb(path);
  if (!pixels.ok()) FailBend(std::string(pixels.status().message()));
  return *std::move(pixels);
}

// Replaces the first `count` photographs by files with this extension and the bytes that `encode` makes of their RGB.
void EncodeImages(const std::string& scene, size_t count, const std::string& extension,
                  const std::function<std::string(const ByteImage&)>& encode) {
  std::vector<TextImage> images = ReadTextImages(scene);
  for (size_t i = 0; i < std::min(count, images.size()); ++i) {
    const std::string path = scene + "/images/" + images[i].name;
    const std::string bytes = encode(Photograph(path));
    fs::remove(path);
    images[i].name = images[i].Stem() + extension;
    WriteText(scene + "/images/" + images[i].name, bytes);
  }
  WriteTextImages(scene, images);
}

constexpr size_t kAllImages = 1000000;

// Edits photographs as OpenCV images of BGR, and writes them as JPEG under the same names.
void EditJpeg(const std::string& path, const std::function<cv::Mat(const cv::Mat&)>& edit,
              const std::vector<int>& options = {cv::IMWRITE_JPEG_QUALITY, 95}) {
  const cv::Mat image = edit(cv::imread(path, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION));
  std::vector<uint8_t> bytes;
  if (image.empty() || !cv::imencode(".jpg", image, bytes, options)) FailBend(path);
  WriteText(path, {bytes.begin(), bytes.end()});
}

cv::Mat Same(const cv::Mat& image) { return image; }

// 0 where `outside` of (u, v), both from -1 at the left or top to 1.
template <class Outside>
void Blacken(ByteImage* image, const Outside& outside) {
  for (int y = 0; y < image->height; ++y) {
    for (int x = 0; x < image->width; ++x) {
      if (!outside(2.0 * x / image->width - 1, 2.0 * y / image->height - 1)) continue;
      for (int c = 0; c < image->channels; ++c) image->at(x, y, c) = 0;
    }
  }
}

bool OutsideEllipse(double u, double v) { return u * u + v * v > 0.84 * 0.84; }

// RGB with a fourth channel.
ByteImage WithFourth(const ByteImage& rgb, const uint8_t* fourth) {
  ByteImage image(rgb.width, rgb.height, 4, 255);
  std::copy(rgb.data.begin(), rgb.data.end(), image.data.begin());
  if (fourth != nullptr) std::copy_n(fourth, rgb.plane_size(), image.plane(3));
  return image;
}

std::string Tiff16(const ByteImage& rgb, double factor) {
  return TiffBytes({.width = rgb.width, .height = rgb.height, .channels = 3, .bits = 16},
                   Interleaved<uint16_t>(rgb, factor));
}

}  // namespace

void HalfSizeImages(const std::string& scene) {
  for (const TextImage& image : ReadTextImages(scene)) {
    EditJpeg(scene + "/images/" + image.name, [](const cv::Mat& pixels) {
      cv::Mat half;
      cv::resize(pixels, half, {pixels.cols / 2, pixels.rows / 2}, 0, 0, cv::INTER_AREA);
      return half;
    });
  }
}

void ExifOrientation(const std::string& scene) {
  for (const TextImage& image : ReadTextImages(scene)) {
    const std::string path = scene + "/images/" + image.name;
    WriteText(path, WithExifOrientation(ReadText(path), 6));
  }
}

void TurnedPortrait(const std::string& scene) {
  EditJpeg(ImagePath(scene, 0), [](const cv::Mat& image) {
    cv::Mat turned;
    cv::rotate(image, turned, cv::ROTATE_90_COUNTERCLOCKWISE);
    return turned;
  });
}

void Tiff16Bit12(const std::string& scene) {
  EncodeImages(scene, kAllImages, ".tif", [](const ByteImage& rgb) { return Tiff16(rgb, 16); });
}

void Tiff16BitFull(const std::string& scene) {
  EncodeImages(scene, kAllImages, ".tif", [](const ByteImage& rgb) { return Tiff16(rgb, 257); });
}

void TiffFloat(const std::string& scene) {
  EncodeImages(scene, 1, ".tif", [](const ByteImage& rgb) {
    ByteImage grey(rgb.width, rgb.height);
    std::copy_n(rgb.plane(1), rgb.plane_size(), grey.plane(0));
    return TiffBytes({.width = rgb.width, .height = rgb.height, .bits = 32, .is_float = true},
                     Interleaved<float>(grey, 1.0 / 255));
  });
}

void TiffFourBands(const std::string& scene) {
  EncodeImages(scene, kAllImages, ".tif", [](const ByteImage& rgb) {
    return TiffBytes({.width = rgb.width, .height = rgb.height, .channels = 4, .has_alpha = true},
                     Interleaved<uint8_t>(WithFourth(rgb, rgb.plane(1)), 1));
  });
}

void TruncatedJpeg(const std::string& scene) {
  const std::string path = ImagePath(scene, 1);
  const std::string bytes = ReadText(path);
  WriteText(path, bytes.substr(0, bytes.size() * 6 / 10));
}

void ZeroBytes(const std::string& scene) { WriteText(ImagePath(scene, 1), ""); }

void DamagedInside(const std::string& scene) {
  const size_t images = ReadTextImages(scene).size();
  for (size_t i = 0; i < images; i += 3) {
    const std::string path = ImagePath(scene, i);
    std::string bytes = ReadText(path);
    WriteText(path, bytes.replace(bytes.size() * 4 / 10, 4096, std::string(4096, '\0')));
  }
}

void GreyProgressivePalette(const std::string& scene) {
  EditJpeg(ImagePath(scene, 0), [](const cv::Mat& image) {
    cv::Mat grey;
    cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
    return grey;
  });
  EditJpeg(ImagePath(scene, 1), Same, {cv::IMWRITE_JPEG_QUALITY, 95, cv::IMWRITE_JPEG_PROGRESSIVE, 1});
  const std::string png_called_jpg = ImagePath(scene, 2);
  WriteText(png_called_jpg, PngBytes(Photograph(png_called_jpg)));
  std::vector<TextImage> images = ReadTextImages(scene);
  for (const size_t i : {3, 4}) {
    const std::string path = scene + "/images/" + images.at(i).name;
    const ByteImage rgb = Photograph(path);
    fs::remove(path);
    images[i].name = images[i].Stem() + ".png";
    std::string bytes = PngBytes(WithFourth(rgb, nullptr));
    if (i == 3) {  // a palette of greys
      std::vector<std::array<uint8_t, 3>> palette(256);
      for (size_t k = 0; k < palette.size(); ++k) palette[k].fill(static_cast<uint8_t>(k));
      ByteImage indices(rgb.width, rgb.height);
      std::copy_n(rgb.plane(1), rgb.plane_size(), indices.plane(0));
      bytes = PngBytes(indices, palette);
    }
    WriteText(scene + "/images/" + images[i].name, bytes);
  }
  WriteTextImages(scene, images);
}

void TransparentMasks(const std::string& scene) {
  EncodeImages(scene, kAllImages, ".png", [](const ByteImage& rgb) {
    ByteImage image = WithFourth(rgb, nullptr);
    Blacken(&image, OutsideEllipse);
    return PngBytes(image);
  });
}

void BlackMasks(const std::string& scene) {
  EncodeImages(scene, kAllImages, ".png", [](ByteImage rgb) {
    Blacken(&rgb, OutsideEllipse);
    return PngBytes(rgb);
  });
}

void BlackRims(const std::string& scene) {
  for (const TextImage& image : ReadTextImages(scene)) {
    const std::string path = scene + "/images/" + image.name;
    ByteImage rgb = Photograph(path);
    Blacken(&rgb,
            [](double u, double v) { return std::abs(u) > 0.80 + 0.15 * v * v || std::abs(v) > 0.80 + 0.15 * u * u; });
    if (!WriteJpeg(path, rgb, 95).ok()) FailBend(path);
  }
}

void LargePhotograph(const std::string& scene, int width_px) {
  const int height_px = width_px * 3 / 4;
  EditJpeg(ImagePath(scene, 0),
           [&](const cv::Mat& image) {
             cv::Mat large;
             cv::resize(image, large, {width_px, height_px}, 0, 0, cv::INTER_LINEAR);
             return large;
           },
           {cv::IMWRITE_JPEG_QUALITY, 60});
  std::vector<TextCamera> cameras = ReadTextCameras(scene);
  std::vector<TextImage> images = ReadTextImages(scene);
  TextCamera large;
  for (const TextCamera& camera : cameras) {
    if (camera.id == images.at(0).camera) large = camera;
  }
  const double scales[2] = {static_cast<double>(width_px) / large.width, static_cast<double>(height_px) / large.height};
  for (size_t k = 0; k < 4; ++k) large.parameters.at(k) *= scales[k % 2];
  large.id = 99;
  large.width = width_px;
  large.height = height_px;
  cameras.push_back(large);
  images[0].camera = large.id;
  WriteTextCameras(scene, cameras);
  WriteImagesWithoutPoints(scene, images);
}

void HundredMegapixels(const std::string& scene) { LargePhotograph(scene, 11648); }

void TwentyFiveMegapixels(const std::string& scene) { LargePhotograph(scene, 5824); }

}  // namespace tessera::bent
