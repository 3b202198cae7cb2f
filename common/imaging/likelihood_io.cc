// Reading likelihoods: TIFF, NPY and labels.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/imaging/file_bytes.h"
#include "common/imaging/image_io.h"
#include "common/imaging/label_file.h"
#include "common/imaging/npy.h"
#include "common/imaging/tiff_file.h"
#include "common/imaging/undistort.h"
#include "common/storage/files.h"
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

// The first value of the plane that is no likelihood, or the plane's size.
size_t FirstInvalid(const float* plane, size_t size, bool are_logits) {
  constexpr size_t kBlock = 4096;
  constexpr float kHighest = std::numeric_limits<float>::max();
  const float lowest = are_logits ? -kHighest : 0;
  const auto valid = [&](float value) { return value >= lowest && value <= kHighest; };  // not NaN
  for (size_t begin = 0; begin < size; begin += kBlock) {
    const size_t end = std::min(size, begin + kBlock);
    int invalid = 0;  // without branches, to be vectorised
    for (size_t i = begin; i < end; ++i) invalid |= !(plane[i] >= lowest) | !(plane[i] <= kHighest);
    if (invalid != 0) return static_cast<size_t>(std::find_if_not(plane + begin, plane + end, valid) - plane);
  }
  return size;
}

// Divides the values of pixels [begin, end) by their sums; uniform where a sum is zero. Plane by plane and without
// branches, so that the loops are vectorised.
void DivideBySums(FloatImage& image, size_t begin, size_t end) {
  constexpr size_t kBlock = 1024;
  double sums[kBlock];
  for (; begin < end; begin += kBlock) {
    const size_t count = std::min(kBlock, end - begin);
    std::fill_n(sums, count, 0.0);
    for (int c = 0; c < image.channels; ++c) {
      const float* plane = image.plane(c) + begin;
      for (size_t i = 0; i < count; ++i) sums[i] += plane[i];
    }
    for (size_t i = 0; i < count; ++i) {
      if (sums[i] > 0) continue;
      sums[i] = image.channels;
      for (int c = 0; c < image.channels; ++c) image.plane(c)[begin + i] = 1;
    }
    for (int c = 0; c < image.channels; ++c) {
      float* plane = image.plane(c) + begin;
      for (size_t i = 0; i < count; ++i) plane[i] = static_cast<float>(plane[i] / sums[i]);
    }
  }
}

// Checks every value and makes each pixel sum to one.
Status Normalise(const std::string& path, const char* plane_name, int first_plane, const ImagePart& part,
                 const LikelihoodForm& form, FloatImage& image, LikelihoodPart* result) {
  const bool are_logits = form.values == LikelihoodForm::Values::kLogits;
  for (int c = 0; c < image.channels; ++c) {
    const float* plane = image.plane(c);
    const size_t i = FirstInvalid(plane, image.plane_size(), are_logits);
    if (i == image.plane_size()) continue;
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
  if (are_logits) {
    ApplySoftmax(image);
    return absl::OkStatus();
  }
  MeasureSums(image, result);
  ParallelFor(image.plane_size(), 1 << 16, [&](size_t begin, size_t end) { DivideBySums(image, begin, end); });
  return absl::OkStatus();
}

// The rectangles of a likelihood file (width x height pixels) for a part of the photograph: in the undistorted image
// and in the stored image.
struct Parts {
  LensModel lens;
  ImagePart undistorted, source;
};

// The undistorted one of Parts.
StatusOr<ImagePart> UndistortedPartOf(const std::string& path, int width, int height, const PinholeCamera& camera,
                                      const ImagePart& part) {
  TESSERA_RETURN_IF_ERROR(CheckResolution(path, width, height, camera));
  if (width == camera.width && height == camera.height) return part;
  constexpr int kMargin_px = 2;  // for interpolation
  const double sx = static_cast<double>(width) / camera.width;
  const double sy = static_cast<double>(height) / camera.height;
  return ImagePart{std::max(0, static_cast<int>(std::floor(part.x0 * sx)) - kMargin_px),
                   std::max(0, static_cast<int>(std::floor(part.y0 * sy)) - kMargin_px),
                   std::min(width, static_cast<int>(std::ceil(part.x1 * sx)) + kMargin_px),
                   std::min(height, static_cast<int>(std::ceil(part.y1 * sy)) + kMargin_px)};
}

StatusOr<Parts> PartsOf(const std::string& path, int width, int height, const LensModel& lens, const ImagePart& part) {
  Parts parts;
  TESSERA_ASSIGN_OR_RETURN(parts.undistorted, UndistortedPartOf(path, width, height, lens.pinhole, part));
  parts.lens = lens;
  parts.lens.pinhole = lens.pinhole.Resized(width, height);
  parts.source = SourcePart(parts.lens, parts.undistorted);
  return parts;
}

enum class FileKind { kLabelPng, kArray, kPages };

// Of a likelihood file, by its first bytes. Checks the request as well.
StatusOr<FileKind> KindOf(const std::string& path, int classes, const LensModel& lens, const ImagePart& part) {
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
  if (starts_with("\x89PNG", 4)) return FileKind::kLabelPng;
  if (starts_with("\x93NUMPY", 6)) return FileKind::kArray;
  if (starts_with("II", 2) || starts_with("MM", 2)) return FileKind::kPages;
  if (IsLfsPointer({reinterpret_cast<const char*>(magic.data()), magic.size()})) return LfsPointerError(path);
  return InputError(path, "byte 0", magic.empty() ? "an empty file" : "an unknown format",
                    "likelihoods as TIFF or NPY, or labels as PNG or NPY");
}

// Size of a TIFF with a page a class.
StatusOr<TiffSize> ReadPagesSize(const std::string& path, int classes) {
  TESSERA_ASSIGN_OR_RETURN(const TiffSize size, ReadTiffSize(path));
  if (size.pages == classes) return size;
  return InputError(path, "", absl::StrCat(size.pages, size.pages == 1 ? " page" : " pages"),
                    absl::StrCat(classes, " (one page per class)"));
}

// The array with its axes in the order of planes: one of ids, or a plane a class.
StatusOr<NpyArray> ArrangedArray(NpyArray array, int classes, const LensModel& lens, const LikelihoodForm& form,
                                 const std::string& path) {
  if (!IsIdArray(array, classes)) return ArrangeNpy(array, classes, lens.pinhole, form.layout, path);
  return array.channels != 1 ? ChannelsLast(array) : array;
}

// The arranged array of a file, without values.
StatusOr<NpyArray> ReadArrayHeader(const std::string& path, int classes, const LensModel& lens,
                                   const LikelihoodForm& form) {
  constexpr int64_t kMostHeader_bytes = int64_t{1} << 17;
  TESSERA_ASSIGN_OR_RETURN(std::vector<uint8_t> bytes, ReadFileStart(path, kMostHeader_bytes));
  TESSERA_ASSIGN_OR_RETURN(const FileStamp stamp, StampOf(path));
  StatusOr<NpyArray> array = FindNpyArray(bytes, path, static_cast<size_t>(stamp.size_bytes));
  if (!array.ok() && stamp.size_bytes > kMostHeader_bytes) {  // the header may be longer
    TESSERA_ASSIGN_OR_RETURN(bytes, ReadFileBytes(path));
    array = FindNpyArray(bytes, path);
  }
  TESSERA_RETURN_IF_ERROR(array.status());
  return ArrangedArray(*array, classes, lens, form, path);
}

}  // namespace

StatusOr<LikelihoodPart> ReadLikelihoodPart(const std::string& path, int classes, const LensModel& lens,
                                            const ImagePart& part, const LikelihoodForm& form) {
  TESSERA_ASSIGN_OR_RETURN(const FileKind kind, KindOf(path, classes, lens, part));
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
  if (kind == FileKind::kLabelPng) {
    // Check the size before decoding.
    TESSERA_ASSIGN_OR_RETURN(const ImageSize size, ReadImageSize(path));
    TESSERA_ASSIGN_OR_RETURN(parts, set_size(size.width, size.height));
    TESSERA_ASSIGN_OR_RETURN(const StoredLabels stored, ReadLabelPng(path));
    TESSERA_ASSIGN_OR_RETURN(image, from_labels(stored));
  } else if (kind == FileKind::kArray) {
    TESSERA_ASSIGN_OR_RETURN(const std::vector<uint8_t> bytes, ReadFileBytes(path));
    TESSERA_ASSIGN_OR_RETURN(const NpyArray stored_array, FindNpyArray(bytes, path));
    TESSERA_ASSIGN_OR_RETURN(const NpyArray array, ArrangedArray(stored_array, classes, lens, form, path));
    TESSERA_ASSIGN_OR_RETURN(parts, set_size(array.width, array.height));
    if (IsIdArray(stored_array, classes)) {
      StoredLabels stored;
      stored.values = NpyIds(array);
      TESSERA_ASSIGN_OR_RETURN(image, from_labels(stored));
    } else {
      image = NpyPart(array, parts.source);
      TESSERA_RETURN_IF_ERROR(Normalise(path, "class", 0, parts.source, form, image, &result));
    }
  } else {
    TESSERA_ASSIGN_OR_RETURN(const TiffSize size, ReadPagesSize(path, classes));
    TESSERA_ASSIGN_OR_RETURN(parts, set_size(size.width, size.height));
    TESSERA_ASSIGN_OR_RETURN(image, ReadTiffPages(path, size, parts.source));
    TESSERA_RETURN_IF_ERROR(Normalise(path, "page", 1, parts.source, form, image, &result));
  }
  result.x0 = parts.undistorted.x0;
  result.y0 = parts.undistorted.y0;
  result.pixels =
      UndistortPart(std::move(image), parts.source, parts.lens, parts.undistorted, 1.0f / static_cast<float>(classes));
  return result;
}

StatusOr<LikelihoodExtent> ReadLikelihoodExtent(const std::string& path, int classes, const LensModel& lens,
                                                const ImagePart& part, const LikelihoodForm& form) {
  TESSERA_ASSIGN_OR_RETURN(const FileKind kind, KindOf(path, classes, lens, part));
  LikelihoodExtent extent;
  const auto set_size = [&](int width, int height) {
    extent.whole_width = width;
    extent.whole_height = height;
  };
  if (kind == FileKind::kLabelPng) {
    TESSERA_ASSIGN_OR_RETURN(const ImageSize size, ReadImageSize(path));
    set_size(size.width, size.height);
  } else if (kind == FileKind::kArray) {
    TESSERA_ASSIGN_OR_RETURN(const NpyArray array, ReadArrayHeader(path, classes, lens, form));
    set_size(array.width, array.height);
  } else {
    TESSERA_ASSIGN_OR_RETURN(const TiffSize size, ReadPagesSize(path, classes));
    set_size(size.width, size.height);
  }
  TESSERA_ASSIGN_OR_RETURN(extent.part,
                           UndistortedPartOf(path, extent.whole_width, extent.whole_height, lens.pinhole, part));
  return extent;
}

StatusOr<FloatImage> ReadLikelihoods(const std::string& path, int classes, const LensModel& lens,
                                     const LikelihoodForm& form) {
  TESSERA_ASSIGN_OR_RETURN(
      LikelihoodPart all,
      ReadLikelihoodPart(path, classes, lens, {0, 0, lens.pinhole.width, lens.pinhole.height}, form));
  return std::move(all.pixels);
}

}  // namespace tessera
