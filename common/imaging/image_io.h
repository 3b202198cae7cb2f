// Images, likelihoods and label pictures from and to files. OpenCV, libtiff and the NPY format stay behind this header.
#ifndef TESSERA_COMMON_IMAGING_IMAGE_IO_H_
#define TESSERA_COMMON_IMAGING_IMAGE_IO_H_

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/camera.h"
#include "common/imaging/raster.h"

namespace tessera {

struct ImageSize {
  int width = 0, height = 0;
  bool operator==(const ImageSize&) const = default;
};

// Size of an image (JPEG, PNG, TIFF) without keeping its pixels. The file's content decides, not its name.
StatusOr<ImageSize> ReadImageSize(const std::string& path);

// Luminance (Rec. 601) in [0, 1], 8 or 16 bit, grey or RGB, undistorted onto lens.pinhole (bilinear; pixels that fall
// outside the photograph are NaN). The image must have the size of lens.pinhole.
StatusOr<FloatImage> ReadLuminance(const std::string& path, const LensModel& lens);

// The same for a part of the undistorted image, byte for byte as in the whole. The file is decoded as a whole (8 or 16
// bit), but only what the part is sampled from becomes floats. INVALID_ARGUMENT for a part outside the image.
StatusOr<FloatImage> ReadLuminancePart(const std::string& path, const LensModel& lens, const ImagePart& part);

// RGB planes 0..255 as stored, not undistorted. For previews and reports.
StatusOr<ByteImage> ReadRgb(const std::string& path);

// Likelihoods of `classes` classes: multi-page TIFF (8/16 bit or float), NPY (classes x height x width; uint8, float16,
// float32) or a label PNG (class ids, 255 unknown; the named class then gets `label_confidence`, the others share the
// rest). The content decides the format. Values are finite, not negative, and normalised to sum to one a pixel (uniform
// where all are zero). Undistorted by `lens` resized to the file's own resolution; uniform outside the photograph.
// Errors name page or offset: wrong page count, NaN, negative values, another aspect ratio than the image's.
StatusOr<FloatImage> ReadLikelihoods(const std::string& path, int classes, const LensModel& lens,
                                     double label_confidence = 0.8);

// What shows a part of the photograph, in the file's own resolution.
struct LikelihoodPart {
  FloatImage pixels;
  int x0 = 0, y0 = 0;                     // of its first pixel in the file's image
  int whole_width = 0, whole_height = 0;  // of the file's image
};

// The same for the `part` of the undistorted photograph, byte for byte as in the whole; where the file's resolution is
// lower, with two more of its pixels on each side, so that what is interpolated within the part is so too. Of a TIFF
// only the strips or tiles in question are decoded. Values elsewhere in the file are not looked at.
StatusOr<LikelihoodPart> ReadLikelihoodPart(const std::string& path, int classes, const LensModel& lens,
                                            const ImagePart& part, double label_confidence = 0.8);

// Class ids of an 8-bit one-channel PNG, as stored (255: nothing seen).
StatusOr<LabelImage> ReadLabelImage(const std::string& path);

// Planes of an 8-bit PNG as stored: grey, RGB or RGBA (1, 3 or 4 channels); palettes become RGB.
StatusOr<ByteImage> ReadPng(const std::string& path);

// Writers go through a temporary name and rename.
Status WritePng(const std::string& path, const ByteImage& image);  // 1 or 3 (RGB) channels
Status WriteJpeg(const std::string& path, const ByteImage& image, int quality);
Status WriteLikelihoodTiff(const std::string& path, const ByteImage& pages);  // a page a channel, LZW

}  // namespace tessera

#endif  // TESSERA_COMMON_IMAGING_IMAGE_IO_H_
