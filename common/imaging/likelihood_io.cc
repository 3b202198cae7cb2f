// Reading likelihoods: TIFF, NPY and labels.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/imaging/file_bytes.h"
#include "common/imaging/image_io.h"
#include "common/imaging/label_file.h"
#include "common/imaging/npy.h"
#include "common/imaging/tiff_file.h"
#include "common/imaging/undistort.h"
#include "common/storage/lfs_pointer.h"

namespace tessera {
namespace {

constexpr double kLabelConfidence = 0.8;  // likelihood of the class that a label names

// Whether likelihoods of this size may be those of the camera's images: of any lower resolution, or, if the images were
// reduced later, of up to kMostFiner times theirs. The height may be rounded up or down.
bool HasSizeOf(int width, int height, const PinholeCamera& camera) {
  constexpr int kMostFiner = 4;
  const double scale = static_cast<double>(width) / camera.width;
  return width >= 1 && height >= 1 && scale <= kMostFiner && height <= kMostFiner * camera.height &&
         std::abs(height - scale * camera.height) <= std::max(1.0, scale);
}

Status CheckResolution(const std::string& path, int width, int height, const PinholeCamera& camera) {
  if (HasSizeOf(width, height, camera)) return absl::OkStatus();
  return InputError(path, "", absl::StrCat(width, " x ", height, " pixels"),
                    absl::StrCat(camera.width, " x ", camera.height,
                                 " as its image, or another size of the same aspect ratio: resize the output of the "
                                 "classifier to the image"));
}

FloatImage FromLabels(const LabelImage& labels, int classes, const ImagePart& part) {
  FloatImage image(part.width(), part.height(), classes, 1.0f / static_cast<float>(classes));
  if (classes == 1) return image;
  const float named = static_cast<float>(kLabelConfidence);
  const float other = static_cast<float>((1 - kLabelConfidence) / (classes - 1));
  for (size_t i = 0; i < image.plane_size(); ++i) {
    const int x = part.x0 + static_cast<int>(i % image.width), y = part.y0 + static_cast<int>(i / image.width);
    const int label = labels.at(x, y);
    if (label == 255) continue;
    for (int c = 0; c < classes; ++c) image.plane(c)[i] = c == label ? named : other;
  }
  return image;
}

// The array as classes x height x width.
StatusOr<NpyArray> ArrangeNpy(const NpyArray& array, int classes, const PinholeCamera& camera,
                              LikelihoodForm::Layout layout, const std::string& path) {
  if (array.axes == 2) {
    return InputError(path, "header", "two axes of floats",
                      "shape (classes, height, width) or (height, width, classes), or whole numbers (class ids)");
  }
  const NpyArray last = ChannelsLast(array);
  const auto has_size = [&](const NpyArray& a) { return HasSizeOf(a.width, a.height, camera); };
  const auto fits = [&](const NpyArray& a) { return a.channels == classes && has_size(a); };
  const bool is_last = layout == LikelihoodForm::Layout::kByShape
                           ? !fits(array) && (fits(last) || (!has_size(array) && has_size(last)))
                           : layout == LikelihoodForm::Layout::kClassesLast;
  const NpyArray& arranged = is_last ? last : array;
  if (arranged.channels == classes) return arranged;
  return InputError(path, "header", absl::StrCat(arranged.channels, " classes"), absl::StrCat(classes));
}

// Makes each pixel sum to one by the softmax function, as the values are logits.
void ApplySoftmax(FloatImage& image) {
  ParallelForEach(image.plane_size(), 1 << 16, [&](size_t i) {
    double largest = image.plane(0)[i], sum = 0;
    for (int c = 1; c < image.channels; ++c) largest = std::max<double>(largest, image.plane(c)[i]);
    for (int c = 0; c < image.channels; ++c) sum += std::exp(image.plane(c)[i] - largest);
    for (int c = 0; c < image.channels; ++c) {
      float& value = image.plane(c)[i];
      value = static_cast<float>(std::exp(value - largest) / sum);
    }
  });
}

// Sets low_sum and high_sum.
void MeasureSums(const FloatImage& image, LikelihoodPart* result) {
  constexpr size_t kSamples = 4096;
  std::vector<double> sums;
  for (size_t i = 0; i < image.plane_size(); i += std::max<size_t>(1, image.plane_size() / kSamples)) {
    double sum = 0;
    bool is_flat = true;  // without a surface, for example
    for (int c = 0; c < image.channels; ++c) {
      sum += image.plane(c)[i];
      is_flat &= image.plane(c)[i] == image.data[i];
    }
    if (!is_flat) sums.push_back(sum);
  }
  if (sums.empty()) return;
  const auto at = [&](double share) {
    const auto nth = sums.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(sums.size() - 1));
    std::nth_element(sums.begin(), nth, sums.end());
    return *nth;
  };
  result->low_sum = at(0.05);
  result->high_sum = at(0.95);
}

// Checks every value and makes each pixel sum to one.
Status Normalise(const std::string& path, const char* plane_name, int first_plane, const ImagePart& part,
                 const LikelihoodForm& form, FloatImage& image, LikelihoodPart* result) {
  const bool are_logits = form.values == LikelihoodForm::Values::kLogits;
  for (int c = 0; c < image.channels; ++c) {
    const float* plane = image.plane(c);
    for (size_t i = 0; i < image.plane_size(); ++i) {
      if (std::isfinite(plane[i]) && (plane[i] >= 0 || are_logits)) continue;
      return InputError(
          path,
          absl::StrCat(plane_name, " ", c + first_plane, ", pixel (", part.x0 + i % image.width, ", ",
                       part.y0 + i / image.width, ")"),
          std::isnan(plane[i]) ? "NaN" : absl::StrCat(plane[i]),
          are_logits ? "a finite logit"
          : std::isfinite(plane[i])
              ? "a finite likelihood of at least 0; for logits set \"likelihood_values\": \"logits\" in scene.json"
              : "a finite likelihood of at least 0");
    }
  }
  if (are_logits) {
    ApplySoftmax(image);
    return absl::OkStatus();
  }
  MeasureSums(image, result);
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
                                            const ImagePart& part, const LikelihoodForm& form) {
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
  const auto from_labels = [&](const StoredLabels& stored) -> StatusOr<FloatImage> {
    LabelImage labels;
    if (classes > 1) {
      TESSERA_ASSIGN_OR_RETURN(labels, ClassesOf(stored, path, classes, form, parts.source));
    }
    FloatImage of_labels = FromLabels(labels, classes, parts.source);
    LikelihoodPart unused;
    TESSERA_RETURN_IF_ERROR(Normalise(path, "class", 0, parts.source, LikelihoodForm(), of_labels, &unused));
    return of_labels;
  };
  if (starts_with("\x89PNG", 4)) {
    // Check the size before decoding.
    TESSERA_ASSIGN_OR_RETURN(const ImageSize size, ReadImageSize(path));
    TESSERA_ASSIGN_OR_RETURN(parts, set_size(size.width, size.height));
    TESSERA_ASSIGN_OR_RETURN(const StoredLabels stored, ReadLabelPng(path));
    TESSERA_ASSIGN_OR_RETURN(image, from_labels(stored));
  } else if (starts_with("\x93NUMPY", 6)) {
    TESSERA_ASSIGN_OR_RETURN(const std::vector<uint8_t> bytes, ReadFileBytes(path));
    TESSERA_ASSIGN_OR_RETURN(NpyArray array, FindNpyArray(bytes, path));
    if (IsIdArray(array, classes)) {
      if (array.channels != 1) array = ChannelsLast(array);
      TESSERA_ASSIGN_OR_RETURN(parts, set_size(array.width, array.height));
      StoredLabels stored;
      stored.values = NpyIds(array);
      TESSERA_ASSIGN_OR_RETURN(image, from_labels(stored));
    } else {
      TESSERA_ASSIGN_OR_RETURN(array, ArrangeNpy(array, classes, lens.pinhole, form.layout, path));
      TESSERA_ASSIGN_OR_RETURN(parts, set_size(array.width, array.height));
      image = NpyPart(array, parts.source);
      TESSERA_RETURN_IF_ERROR(Normalise(path, "class", 0, parts.source, form, image, &result));
    }
  } else if (starts_with("II", 2) || starts_with("MM", 2)) {
    TESSERA_ASSIGN_OR_RETURN(TiffSize size, ReadTiffSize(path));
    if (size.pages != classes) {
      return InputError(path, "", absl::StrCat(size.pages, size.pages == 1 ? " page" : " pages"),
                        absl::StrCat(classes, " (one page per class)"));
    }
    TESSERA_ASSIGN_OR_RETURN(parts, set_size(size.width, size.height));
    TESSERA_ASSIGN_OR_RETURN(image, ReadTiffPages(path, size, parts.source));
    TESSERA_RETURN_IF_ERROR(Normalise(path, "page", 1, parts.source, form, image, &result));
  } else if (IsLfsPointer({reinterpret_cast<const char*>(magic.data()), magic.size()})) {
    return LfsPointerError(path);
  } else {
    return InputError(path, "byte 0", magic.empty() ? "an empty file" : "an unknown format",
                      "likelihoods as TIFF or NPY, or labels as PNG or NPY");
  }
  result.x0 = parts.undistorted.x0;
  result.y0 = parts.undistorted.y0;
  result.pixels =
      UndistortPart(std::move(image), parts.source, parts.lens, parts.undistorted, 1.0f / static_cast<float>(classes));
  return result;
}

StatusOr<FloatImage> ReadLikelihoods(const std::string& path, int classes, const LensModel& lens,
                                     const LikelihoodForm& form) {
  TESSERA_ASSIGN_OR_RETURN(
      LikelihoodPart all,
      ReadLikelihoodPart(path, classes, lens, {0, 0, lens.pinhole.width, lens.pinhole.height}, form));
  return std::move(all.pixels);
}

}  // namespace tessera
