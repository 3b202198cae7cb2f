// Reading likelihoods: TIFF, NPY and label PNG.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/imaging/file_bytes.h"
#include "common/imaging/image_io.h"
#include "common/imaging/npy.h"
#include "common/imaging/tiff_file.h"
#include "common/imaging/undistort.h"
#include "common/storage/lfs_pointer.h"

namespace tessera {
namespace {

// Likelihoods may have a lower resolution than the photograph; their height may be rounded up or down.
Status CheckResolution(const std::string& path, int width, int height, const PinholeCamera& camera) {
  const double expected_height = static_cast<double>(width) * camera.height / camera.width;
  if (width >= 1 && height >= 1 && width <= camera.width && height <= camera.height &&
      std::abs(height - expected_height) <= 1.0) {
    return absl::OkStatus();
  }
  return InputError(
      path, "", absl::StrCat(width, " x ", height, " pixels"),
      absl::StrCat(camera.width, " x ", camera.height, " as its image, or fewer with the same aspect ratio"));
}

StatusOr<FloatImage> FromLabels(const std::string& path, const LabelImage& labels, int classes, const ImagePart& part,
                                double confidence) {
  FloatImage image(part.width(), part.height(), classes, 1.0f / static_cast<float>(classes));
  if (classes == 1) return image;
  const float named = static_cast<float>(confidence);
  const float other = static_cast<float>((1 - confidence) / (classes - 1));
  for (size_t i = 0; i < image.plane_size(); ++i) {
    const int x = part.x0 + static_cast<int>(i % image.width), y = part.y0 + static_cast<int>(i / image.width);
    const int label = labels.at(x, y);
    if (label == 255) continue;
    if (label >= classes) {
      return InputError(path, absl::StrCat("pixel (", x, ", ", y, ")"), absl::StrCat("label ", label),
                        absl::StrCat("a class from 0 to ", classes - 1, ", or 255 for unknown"));
    }
    for (int c = 0; c < classes; ++c) image.plane(c)[i] = c == label ? named : other;
  }
  return image;
}

// Checks every value and makes each pixel sum to one.
Status Normalise(const std::string& path, const char* plane_name, int first_plane, const ImagePart& part,
                 FloatImage& image) {
  for (int c = 0; c < image.channels; ++c) {
    const float* plane = image.plane(c);
    for (size_t i = 0; i < image.plane_size(); ++i) {
      if (std::isfinite(plane[i]) && plane[i] >= 0) continue;
      return InputError(path,
                        absl::StrCat(plane_name, " ", c + first_plane, ", pixel (", part.x0 + i % image.width, ", ",
                                     part.y0 + i / image.width, ")"),
                        std::isnan(plane[i]) ? "NaN" : absl::StrCat(plane[i]), "a finite likelihood of at least 0");
    }
  }
  ParallelForEach(image.plane_size(), 1 << 16, [&](size_t i) {
    double sum = 0;
    for (int c = 0; c < image.channels; ++c) sum += image.plane(c)[i];
    for (int c = 0; c < image.channels; ++c) {
      float& value = image.plane(c)[i];
      value = static_cast<float>(sum > 0 ? value / sum : 1.0 / image.channels);
    }
  });
  return absl::OkStatus();
}

// The rectangles of a likelihood file (width x height pixels) for a part of the photograph: in the undistorted image
// and in the stored image.
struct Parts {
  LensModel lens;
  ImagePart undistorted, source;
};

StatusOr<Parts> PartsOf(const std::string& path, int width, int height, const LensModel& lens, const ImagePart& part) {
  TESSERA_RETURN_IF_ERROR(CheckResolution(path, width, height, lens.pinhole));
  Parts parts;
  parts.lens = lens;
  parts.lens.pinhole = lens.pinhole.Resized(width, height);
  parts.undistorted = part;
  if (width != lens.pinhole.width || height != lens.pinhole.height) {
    constexpr int kMargin_px = 2;  // for interpolation
    const double sx = static_cast<double>(width) / lens.pinhole.width;
    const double sy = static_cast<double>(height) / lens.pinhole.height;
    parts.undistorted = {std::max(0, static_cast<int>(std::floor(part.x0 * sx)) - kMargin_px),
                         std::max(0, static_cast<int>(std::floor(part.y0 * sy)) - kMargin_px),
                         std::min(width, static_cast<int>(std::ceil(part.x1 * sx)) + kMargin_px),
                         std::min(height, static_cast<int>(std::ceil(part.y1 * sy)) + kMargin_px)};
  }
  parts.source = SourcePart(parts.lens, parts.undistorted);
  return parts;
}

}  // namespace

StatusOr<LikelihoodPart> ReadLikelihoodPart(const std::string& path, int classes, const LensModel& lens,
                                            const ImagePart& part, double label_confidence) {
  if (classes < 1) return absl::InvalidArgumentError(path + ": need at least 1 class");
  if (part.x0 < 0 || part.y0 < 0 || part.x1 > lens.pinhole.width || part.y1 > lens.pinhole.height ||
      part.width() <= 0 || part.height() <= 0) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": found columns ", part.x0, " to ", part.x1, ", rows ", part.y0, " to ", part.y1,
        ", expected a part of the ", lens.pinhole.width, " x ", lens.pinhole.height, " pixels of its image"));
  }
  TESSERA_ASSIGN_OR_RETURN(const std::vector<uint8_t> magic, ReadFileStart(path, 32));
  const auto starts_with = [&](const char* text, size_t size) {
    return magic.size() >= size && std::memcmp(magic.data(), text, size) == 0;
  };
  LikelihoodPart result;
  const auto set_size = [&](int width, int height) {
    result.whole_width = width;
    result.whole_height = height;
    return PartsOf(path, width, height, lens, part);
  };
  Parts parts;
  FloatImage image;
  if (starts_with("\x89PNG", 4)) {
    // Check the size before decoding.
    TESSERA_ASSIGN_OR_RETURN(const ImageSize size, ReadImageSize(path));
    TESSERA_ASSIGN_OR_RETURN(parts, set_size(size.width, size.height));
    TESSERA_ASSIGN_OR_RETURN(const LabelImage labels, ReadLabelImage(path));
    TESSERA_ASSIGN_OR_RETURN(image, FromLabels(path, labels, classes, parts.source, label_confidence));
    TESSERA_RETURN_IF_ERROR(Normalise(path, "class", 0, parts.source, image));
  } else if (starts_with("\x93NUMPY", 6)) {
    TESSERA_ASSIGN_OR_RETURN(const std::vector<uint8_t> bytes, ReadFileBytes(path));
    TESSERA_ASSIGN_OR_RETURN(const NpyArray array, FindNpyArray(bytes, path));
    if (array.channels != classes) {
      return InputError(path, "header", absl::StrCat(array.channels, " classes"), absl::StrCat(classes));
    }
    TESSERA_ASSIGN_OR_RETURN(parts, set_size(array.width, array.height));
    image = NpyPart(array, parts.source);
    TESSERA_RETURN_IF_ERROR(Normalise(path, "class", 0, parts.source, image));
  } else if (starts_with("II", 2) || starts_with("MM", 2)) {
    TESSERA_ASSIGN_OR_RETURN(TiffSize size, ReadTiffSize(path));
    if (size.pages != classes) {
      return InputError(path, "", absl::StrCat(size.pages, size.pages == 1 ? " page" : " pages"),
                        absl::StrCat(classes, " (one page per class)"));
    }
    TESSERA_ASSIGN_OR_RETURN(parts, set_size(size.width, size.height));
    TESSERA_ASSIGN_OR_RETURN(image, ReadTiffPages(path, size, parts.source));
    TESSERA_RETURN_IF_ERROR(Normalise(path, "page", 1, parts.source, image));
  } else if (IsLfsPointer({reinterpret_cast<const char*>(magic.data()), magic.size()})) {
    return LfsPointerError(path);
  } else {
    return InputError(path, "byte 0", magic.empty() ? "an empty file" : "an unknown format",
                      "likelihoods as TIFF or NPY, or a label PNG");
  }
  result.x0 = parts.undistorted.x0;
  result.y0 = parts.undistorted.y0;
  result.pixels =
      UndistortPart(std::move(image), parts.source, parts.lens, parts.undistorted, 1.0f / static_cast<float>(classes));
  return result;
}

StatusOr<FloatImage> ReadLikelihoods(const std::string& path, int classes, const LensModel& lens,
                                     double label_confidence) {
  TESSERA_ASSIGN_OR_RETURN(
      LikelihoodPart all,
      ReadLikelihoodPart(path, classes, lens, {0, 0, lens.pinhole.width, lens.pinhole.height}, label_confidence));
  return std::move(all.pixels);
}

}  // namespace tessera
