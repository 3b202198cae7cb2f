// Reading and writing of images, likelihoods and label images. OpenCV and libtiff are used in the .cc files only.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/camera.h"
#include "common/imaging/likelihood_form.h"
#include "common/imaging/raster.h"

namespace tessera {

struct ImageSize {
  int width = 0, height = 0;
  bool operator==(const ImageSize&) const = default;
};

// Size of an image (JPEG, PNG, TIFF), read from its header. The format is detected from the content, not from the name.
StatusOr<ImageSize> ReadImageSize(const std::string& path);

// How the pixels of a photograph are used.
struct PhotographOptions {
  std::string mask_path = {};  // an image (ReadMask); its black pixels are masked. Empty: none
  int white_level = 0;         // the sample value of 16-bit images that is luminance 1; 0: 65535
};

// Luminance (Rec. 601) in [0, 1] of an 8- or 16-bit grey or RGB image, undistorted onto lens.pinhole (bilinear; NaN
// outside the photograph, where it is masked and where its alpha channel is 0). The image must have the size of
// lens.pinhole; a tag that says how to turn it is ignored.
StatusOr<FloatImage> ReadLuminance(const std::string& path, const LensModel& lens,
                                   const PhotographOptions& options = {});

// The same for a part of the undistorted image; bit-identical to that part of the whole. The whole file is decoded, but
// only the pixels that the part needs are converted to float. INVALID_ARGUMENT for a part outside the image.
StatusOr<FloatImage> ReadLuminancePart(const std::string& path, const LensModel& lens, const ImagePart& part,
                                       const PhotographOptions& options = {});

// The same for colours: planes of red, green and blue, which are equal for a grey image. Values above 1 are possible if
// samples are above the white level.
StatusOr<FloatImage> ReadColorPart(const std::string& path, const LensModel& lens, const ImagePart& part,
                                   const PhotographOptions& options = {});

// RGB planes, 0 to 255, as stored, not undistorted. `white_level`: as in PhotographOptions.
StatusOr<ByteImage> ReadRgb(const std::string& path, int white_level = 0);

// A mask for a photograph of the given size: 0 where it is black, else 255. INVALID_ARGUMENT for another aspect ratio.
StatusOr<ByteImage> ReadMask(const std::string& path, const ImageSize& photograph);

// The highest sample of a 16-bit image, alpha excluded, or its TIFF tag MaxSampleValue if that is higher. 0 for an
// image of 8 bits. Decodes 16-bit images.
StatusOr<int> HighestSample(const std::string& path);

// Likelihoods of `classes` classes, from one of these formats, detected from the content: multi-page TIFF (8/16 bit or
// float), NPY (three axes, npy.h), or labels (label_file.h): the class of a pixel gets 0.8, the others share the rest;
// uniform where it is unknown. `form`: of the scene's files. The result sums to one per pixel (uniform where all values
// are zero). It is undistorted by `lens`, resized to the file's resolution; uniform outside the photograph.
// INVALID_ARGUMENT with the page or offset for a wrong page count, NaN, negative values that are no logits, or an
// aspect ratio that differs from the image's.
StatusOr<FloatImage> ReadLikelihoods(const std::string& path, int classes, const LensModel& lens,
                                     const LikelihoodForm& form = LikelihoodForm());

// Likelihoods of a part of the photograph, in the resolution of the likelihood file.
struct LikelihoodPart {
  FloatImage pixels;
  int x0 = 0, y0 = 0;                     // position of the first pixel in the whole likelihood image
  int whole_width = 0, whole_height = 0;  // size of the whole likelihood image
  // Sums of the stored values of a pixel, where they differ: 5 and 95 % of about 4,000 pixels are lower. 0: labels,
  // logits, or equal values everywhere.
  double low_sum = 0, high_sum = 0;
};

// The same for `part` of the undistorted photograph; bit-identical to that part of the whole. If the file's resolution
// is lower, the result has two more pixels on each side, so that interpolation inside the part is also identical. Of a
// TIFF only the needed strips or tiles are decoded. Values outside the part are not checked.
StatusOr<LikelihoodPart> ReadLikelihoodPart(const std::string& path, int classes, const LensModel& lens,
                                            const ImagePart& part, const LikelihoodForm& form = LikelihoodForm());

// Where the pixels of ReadLikelihoodPart lie.
struct LikelihoodExtent {
  ImagePart part;                         // of the whole likelihood image
  int whole_width = 0, whole_height = 0;  // its size
};

// From the file's header, without decoding pixels. Errors of the header and of the resolution as ReadLikelihoodPart.
StatusOr<LikelihoodExtent> ReadLikelihoodExtent(const std::string& path, int classes, const LensModel& lens,
                                                const ImagePart& part, const LikelihoodForm& form = LikelihoodForm());

// Class ids of an 8-bit one-channel PNG, as stored (255: unknown).
StatusOr<LabelImage> ReadLabelImage(const std::string& path);

// Planes of an 8-bit PNG as stored: grey, RGB or RGBA (1, 3 or 4 channels); palettes become RGB.
StatusOr<ByteImage> ReadPng(const std::string& path);

// One number per pixel: the grey level as stored, or 0xAARRGGBB of the 8 highest bits of each channel.
struct PngPixels {
  bool is_color = false;
  Raster<uint32_t> values;
};

// The pixels of the PNG in `bytes`, of 8 or 16 bits; palettes become RGB. `path` is for messages.
StatusOr<PngPixels> DecodePngPixels(const std::string& path, const std::vector<uint8_t>& bytes);

// Writers replace files atomically (temporary file, then rename).
Status WritePng(const std::string& path, const ByteImage& image);  // 1 or 3 (RGB) channels
Status WriteJpeg(const std::string& path, const ByteImage& image, int quality);
Status WriteLikelihoodTiff(const std::string& path, const ByteImage& pages);  // one page per channel, LZW

}  // namespace tessera
