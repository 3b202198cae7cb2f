// Reading likelihoods: TIFF, NPY and label PNG.
#include <cmath>
#include <cstring>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/imaging/file_bytes.h"
#include "common/imaging/image_io.h"
#include "common/imaging/npy.h"
#include "common/imaging/tiff_file.h"
#include "common/imaging/undistort.h"

namespace tessera {
namespace {

// Likelihoods may be coarser than the photograph, their height rounded either way.
Status CheckResolution(const std::string& path, int width, int height, const PinholeCamera& camera) {
  const double expected_height = static_cast<double>(width) * camera.height / camera.width;
  if (width >= 1 && height >= 1 && width <= camera.width && height <= camera.height &&
      std::abs(height - expected_height) <= 1.0) {
    return absl::OkStatus();
  }
  return InputError(
      path, "", absl::StrCat(width, " x ", height, " pixels"),
      absl::StrCat("the ", camera.width, " x ", camera.height, " of its image, or less with the same aspect ratio"));
}

StatusOr<FloatImage> FromLabels(const std::string& path, int classes, const LensModel& lens, double confidence) {
  TESSERA_ASSIGN_OR_RETURN(const LabelImage labels, ReadLabelImage(path));
  TESSERA_RETURN_IF_ERROR(CheckResolution(path, labels.width, labels.height, lens.pinhole));
  FloatImage image(labels.width, labels.height, classes, 1.0f / static_cast<float>(classes));
  if (classes == 1) return image;
  const float named = static_cast<float>(confidence);
  const float other = static_cast<float>((1 - confidence) / (classes - 1));
  for (size_t i = 0; i < labels.data.size(); ++i) {
    const int label = labels.data[i];
    if (label == 255) continue;
    if (label >= classes) {
      return InputError(path, absl::StrCat("pixel (", i % labels.width, ", ", i / labels.width, ")"),
                        absl::StrCat("label ", label), absl::StrCat("0 to ", classes - 1, ", or 255 for unknown"));
    }
    for (int c = 0; c < classes; ++c) image.plane(c)[i] = c == label ? named : other;
  }
  return image;
}

// Checks every value and makes each pixel sum to one.
Status Normalise(const std::string& path, const char* plane_name, int first_plane, FloatImage& image) {
  for (int c = 0; c < image.channels; ++c) {
    const float* plane = image.plane(c);
    for (size_t i = 0; i < image.plane_size(); ++i) {
      if (std::isfinite(plane[i]) && plane[i] >= 0) continue;
      return InputError(
          path,
          absl::StrCat(plane_name, " ", c + first_plane, ", pixel (", i % image.width, ", ", i / image.width, ")"),
          std::isnan(plane[i]) ? "NaN" : absl::StrCat(plane[i]), "a finite likelihood that is not negative");
    }
  }
  ParallelFor(static_cast<int64_t>(image.plane_size()), 1 << 16, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      double sum = 0;
      for (int c = 0; c < image.channels; ++c) sum += image.plane(c)[i];
      for (int c = 0; c < image.channels; ++c) {
        float& value = image.plane(c)[i];
        value = static_cast<float>(sum > 0 ? value / sum : 1.0 / image.channels);
      }
    }
  });
  return absl::OkStatus();
}

}  // namespace

StatusOr<FloatImage> ReadLikelihoods(const std::string& path, int classes, const LensModel& lens,
                                     double label_confidence) {
  if (classes < 1) return absl::InvalidArgumentError("likelihoods need at least one class");
  TESSERA_ASSIGN_OR_RETURN(const std::vector<uint8_t> magic, ReadFileStart(path, 8));
  const auto begins = [&](const char* text, size_t size) {
    return magic.size() >= size && std::memcmp(magic.data(), text, size) == 0;
  };
  FloatImage image;
  if (begins("\x89PNG", 4)) {
    TESSERA_ASSIGN_OR_RETURN(image, FromLabels(path, classes, lens, label_confidence));
    TESSERA_RETURN_IF_ERROR(Normalise(path, "class", 0, image));
  } else if (begins("\x93NUMPY", 6)) {
    TESSERA_ASSIGN_OR_RETURN(const std::vector<uint8_t> bytes, ReadFileBytes(path));
    TESSERA_ASSIGN_OR_RETURN(image, ParseNpy(bytes, path));
    if (image.channels != classes) {
      return InputError(path, "header", absl::StrCat(image.channels, " classes"), absl::StrCat(classes));
    }
    TESSERA_RETURN_IF_ERROR(CheckResolution(path, image.width, image.height, lens.pinhole));
    TESSERA_RETURN_IF_ERROR(Normalise(path, "class", 0, image));
  } else if (begins("II", 2) || begins("MM", 2)) {
    TESSERA_ASSIGN_OR_RETURN(TiffSize size, ReadTiffSize(path));
    if (size.pages != classes) {
      return InputError(path, "", absl::StrCat(size.pages, size.pages == 1 ? " page" : " pages"),
                        absl::StrCat(classes, " (a page a class)"));
    }
    TESSERA_RETURN_IF_ERROR(CheckResolution(path, size.width, size.height, lens.pinhole));
    TESSERA_ASSIGN_OR_RETURN(image, ReadTiffPages(path, size));
    TESSERA_RETURN_IF_ERROR(Normalise(path, "page", 1, image));
  } else {
    return InputError(path, "byte 0", magic.empty() ? "an empty file" : "another kind of file",
                      "likelihoods as TIFF or NPY, or a label PNG");
  }
  LensModel resized = lens;
  resized.pinhole = lens.pinhole.Resized(image.width, image.height);
  return Undistort(std::move(image), resized, 1.0f / static_cast<float>(classes));
}

}  // namespace tessera
