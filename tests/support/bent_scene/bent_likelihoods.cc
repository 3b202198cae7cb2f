// Likelihoods in the forms of other programs.
#include <cmath>
#include <filesystem>
#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "absl/strings/str_cat.h"
#include "common/imaging/raster.h"
#include "tests/support/bent_scene/bent_scene.h"
#include "tests/support/bent_scene/class_colours.h"
#include "tests/support/bent_scene/picture_files.h"
#include "tests/support/bent_scene/raw_bytes.h"
#include "tests/support/bent_scene/text_model.h"
#include "tests/support/tiny_scene.h"

namespace tessera::bent {
namespace {

namespace fs = std::filesystem;

// An NPY file in C order. `descr`: such as "<f4".
std::string Npy(const std::string& descr, const std::vector<int>& shape, const std::string& values) {
  std::string header = absl::StrCat("{'descr': '", descr, "', 'fortran_order': False, 'shape': (");
  for (const int size : shape) absl::StrAppend(&header, size, ", ");
  header += "), }";
  while ((10 + header.size() + 1) % 64 != 0) header += ' ';
  header += '\n';
  return std::string("\x93NUMPY\x01\x00", 8) + Raw<uint16_t>({static_cast<uint16_t>(header.size())}) + header + values;
}

// The values of all planes as float32, after `map`.
template <class Map>
std::string Floats(const FloatImage& image, const Map& map) {
  std::vector<float> values;
  values.reserve(image.data.size());
  for (const float value : image.data) values.push_back(map(value));
  return Raw(values);
}

std::string Floats(const FloatImage& image) {
  return Floats(image, [](float value) { return value; });
}

std::vector<int> ChwShape(const FloatImage& image) { return {image.channels, image.height, image.width}; }
std::vector<int> HwcShape(const FloatImage& image) { return {image.height, image.width, image.channels}; }

// The pixels' values of all classes together, as T.
template <class T>
std::string HwcValues(const FloatImage& image) {
  std::vector<T> values;
  for (size_t i = 0; i < image.plane_size(); ++i) {
    for (int c = 0; c < image.channels; ++c) values.push_back(image.plane(c)[i]);
  }
  return Raw(values);
}

// The first likeliest class of each pixel.
ByteImage Likeliest(const FloatImage& image) {
  ByteImage ids(image.width, image.height);
  for (size_t i = 0; i < image.plane_size(); ++i) {
    for (int c = 1; c < image.channels; ++c) {
      if (image.plane(c)[i] > image.plane(ids.data[i])[i]) ids.data[i] = static_cast<uint8_t>(c);
    }
  }
  return ids;
}

// The likelihoods of a view, with a sum of one per pixel.
FloatImage Likelihoods(const std::string& path) {
  std::vector<cv::Mat> pages;
  if (!cv::imreadmulti(path, pages, cv::IMREAD_UNCHANGED)) FailBend(path);
  FloatImage image(pages[0].cols, pages[0].rows, static_cast<int>(pages.size()));
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      float sum = 0;
      for (int c = 0; c < image.channels; ++c) sum += image.at(x, y, c) = pages[c].at<uint8_t>(y, x);
      for (int c = 0; c < image.channels; ++c) image.at(x, y, c) /= std::max(sum, 1e-6f);
    }
  }
  return image;
}

// Replaces the likelihoods of each view by a file with this extension and the bytes that `encode` makes of them.
void EncodeLikelihoods(const std::string& scene, const std::string& extension,
                       const std::function<std::string(FloatImage)>& encode) {
  for (const TextImage& image : ReadTextImages(scene)) {
    const std::string stem = scene + "/likelihoods/" + image.Stem();
    const std::string bytes = encode(Likelihoods(stem + ".tif"));
    fs::remove(stem + ".tif");
    WriteText(stem + extension, bytes);
  }
}

// The log of the likelihoods, shifted.
std::function<std::string(FloatImage)> Logits(float shift) {
  return [shift](const FloatImage& image) {
    return Npy("<f4", ChwShape(image), Floats(image, [shift](float value) { return std::log(value + 1e-3f) + shift; }));
  };
}

}  // namespace

void PlainNpy(const std::string& scene) {
  EncodeLikelihoods(scene, ".npy", [](const FloatImage& image) { return Npy("<f4", ChwShape(image), Floats(image)); });
}

void PlainLabels(const std::string& scene) {
  EncodeLikelihoods(scene, ".png", [](const FloatImage& image) { return PngBytes(Likeliest(image)); });
}

void NpyFloat64Hwc(const std::string& scene) {
  EncodeLikelihoods(scene, ".npy",
                    [](const FloatImage& image) { return Npy("<f8", HwcShape(image), HwcValues<double>(image)); });
}

void NpyHwcFloat32(const std::string& scene) {
  EncodeLikelihoods(scene, ".npy",
                    [](const FloatImage& image) { return Npy("<f4", HwcShape(image), HwcValues<float>(image)); });
}

void NpyLogits(const std::string& scene) { EncodeLikelihoods(scene, ".npy", Logits(2)); }

void NpyLogitsShifted(const std::string& scene) { EncodeLikelihoods(scene, ".npy", Logits(7)); }

void NpyArgmaxInt64(const std::string& scene) {
  EncodeLikelihoods(scene, ".npy", [](const FloatImage& image) {
    const ByteImage ids = Likeliest(image);
    return Npy("<i8", {ids.height, ids.width}, Raw(std::vector<int64_t>(ids.data.begin(), ids.data.end())));
  });
}

void NpyBatchAxis(const std::string& scene) {
  EncodeLikelihoods(scene, ".npy", [](const FloatImage& image) {
    return Npy("<f4", {1, image.channels, image.height, image.width}, Floats(image));
  });
}

void PaletteLabels(const std::string& scene) {
  EncodeLikelihoods(scene, ".png", [](const FloatImage& image) {
    return PngBytes(Likeliest(image), {kClassColours.begin(), kClassColours.end()});
  });
}

void ColourLabels(const std::string& scene) {
  EncodeLikelihoods(scene, ".png", [](const FloatImage& image) { return PngBytes(InClassColours(Likeliest(image))); });
}

void LabelsFromOne(const std::string& scene) {
  EncodeLikelihoods(scene, ".png", [](const FloatImage& image) {
    ByteImage ids = Likeliest(image);
    for (uint8_t& id : ids.data) ++id;
    return PngBytes(ids);
  });
}

void UpperCaseSuffix(const std::string& scene) {
  for (const TextImage& image : ReadTextImages(scene)) {
    const std::string stem = scene + "/likelihoods/" + image.Stem();
    fs::rename(stem + ".tif", stem + ".TIF");
  }
}

void NanAndZero(const std::string& scene) {
  int view = 0;
  EncodeLikelihoods(scene, ".npy", [&view](FloatImage image) {
    if (view == 0) {
      for (int y = 10; y < 20; ++y) {
        for (int x = 10; x < 30; ++x) {
          for (int c = 0; c < image.channels; ++c) image.at(x, y, c) = 0;
        }
      }
    }
    if (view == 1) image.at(7, 5, 2) = NAN;
    ++view;
    return Npy("<f4", ChwShape(image), Floats(image));
  });
}

void AllZeroFiles(const std::string& scene) {
  EncodeLikelihoods(scene, ".npy", [](const FloatImage& image) {
    return Npy("<f4", ChwShape(image), Floats(image, [](float) { return 0.0f; }));
  });
}

void ClassesInAnotherOrder(const std::string& scene) {
  EncodeLikelihoods(scene, ".npy", [](const FloatImage& image) {
    FloatImage ordered = image;
    for (int c = 0; c < 4; ++c) std::copy_n(image.plane(c ^ 1), image.plane_size(), ordered.plane(c));
    return Npy("<f4", ChwShape(ordered), Floats(ordered));
  });
}

void HalfOfTheLikelihoods(const std::string& scene) {
  const std::vector<TextImage> images = ReadTextImages(scene);
  for (size_t i = 0; i < images.size(); i += 2) fs::remove(scene + "/likelihoods/" + images[i].Stem() + ".tif");
}

void Square512(const std::string& scene) {
  EncodeLikelihoods(scene, ".npy", [](FloatImage image) {
    std::string values;
    for (int c = 0; c < image.channels; ++c) {
      cv::Mat resized;
      cv::resize(cv::Mat(image.height, image.width, CV_32F, image.plane(c)), resized, {512, 512});
      values += Raw(std::vector<float>(resized.begin<float>(), resized.end<float>()));
    }
    return Npy("<f4", {image.channels, 512, 512}, values);
  });
}

}  // namespace tessera::bent
