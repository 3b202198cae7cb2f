// Annotations in the forms of painting programs.
#include <filesystem>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "common/imaging/image_io.h"
#include "tests/support/bent_scene/bent_scene.h"
#include "tests/support/bent_scene/class_colours.h"
#include "tests/support/bent_scene/picture_files.h"
#include "tests/support/bent_scene/text_model.h"
#include "tests/support/tiny_scene.h"

namespace tessera::bent {
namespace {

// The truth along strokes and in a rectangle; 255 elsewhere.
ByteImage Strokes(const ByteImage& truth) {
  ByteImage painted(truth.width, truth.height, 1, 255);
  for (int y = 20; y < 281 && y < truth.height; ++y) {
    for (int x = 0; x < truth.width; ++x) {
      const bool stroke = (y - 20) % 25 < 2, area = y >= 100 && y < 160 && x >= 100 && x < 250;
      if (stroke || area) painted.at(x, y) = truth.at(x, y);
    }
  }
  return painted;
}

cv::Mat ToBgr(const ByteImage& rgb) {
  cv::Mat image(rgb.height, rgb.width, CV_8UC3);
  for (size_t i = 0; i < rgb.plane_size(); ++i) {
    image.at<cv::Vec3b>(static_cast<int>(i)) = {rgb.plane(2)[i], rgb.plane(1)[i], rgb.plane(0)[i]};
  }
  return image;
}

ByteImage EverySecondPixel(const ByteImage& image) {
  ByteImage half(image.width / 2, image.height / 2);
  for (int y = 0; y < half.height; ++y) {
    for (int x = 0; x < half.width; ++x) half.at(x, y) = image.at(2 * x, 2 * y);
  }
  return half;
}

std::string Encoded(const std::string& extension, const cv::Mat& image) {
  std::vector<uint8_t> bytes;
  if (!cv::imencode(extension, image, bytes)) FailBend("cannot encode " + extension);
  return {bytes.begin(), bytes.end()};
}

}  // namespace

void PaintAnnotations(const std::string& folder, const std::string& form) {
  std::filesystem::create_directories(folder);
  for (const std::string stem : {"nadir_00_001", "north_00_001", "east_00_001", "south_00_001"}) {
    const auto truth = ReadLabelImage(BaseScene() + "/truth/" + stem + "_label.png");
    if (!truth.ok()) FailBend(std::string(truth.status().message()));
    const ByteImage ids = Strokes(*truth);
    const cv::Mat colours = ToBgr(InClassColours(ids));
    std::string name = stem + ".png", bytes;
    if (form == "ids") bytes = PngBytes(ids);
    if (form == "colours") bytes = Encoded(".png", colours);
    if (form == "jpeg-colours") {
      const std::string jpeg = Encoded(".jpg", colours);
      bytes = Encoded(".png", cv::imdecode(std::vector<uint8_t>(jpeg.begin(), jpeg.end()), cv::IMREAD_COLOR));
    }
    if (form == "antialiased") {
      cv::Mat large, blurred;
      cv::resize(colours, large, colours.size() * 2, 0, 0, cv::INTER_CUBIC);
      cv::resize(large, blurred, colours.size(), 0, 0, cv::INTER_AREA);
      bytes = Encoded(".png", blurred);
    }
    if (form == "palette") {
      std::vector<std::array<uint8_t, 3>> palette(kClassColours.begin(), kClassColours.end());
      palette.push_back({255, 255, 255});
      ByteImage indices = ids;
      for (uint8_t& id : indices.data) id = std::min<uint8_t>(id, 4);
      bytes = PngBytes(indices, palette);
    }
    if (form == "double-suffix") {
      name = stem + ".jpg.png";
      bytes = PngBytes(ids);
    }
    if (form == "half-size") bytes = PngBytes(EverySecondPixel(ids));
    if (bytes.empty()) FailBend("no form of annotations: " + form);
    WriteText(folder + "/" + name, bytes);
  }
}

}  // namespace tessera::bent
