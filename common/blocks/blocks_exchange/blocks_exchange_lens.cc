#include "common/blocks/blocks_exchange/blocks_exchange_lens.h"

#include <Eigen/Geometry>
#include <algorithm>

#include "absl/strings/str_cat.h"
#include "common/base/printable.h"
#include "common/blocks/block_parts.h"

namespace tessera {
namespace {

constexpr int64_t kMaxExchangeSide_px = 1'000'000;

// The direction that `text` begins with, in the axes of our cameras (x right, y down); removes it from `text`.
std::optional<Eigen::Vector3d> TakeExchangeDirection(std::string_view* text) {
  const std::pair<std::string_view, Eigen::Vector3d> directions[] = {
      {"Right", {1, 0, 0}}, {"Left", {-1, 0, 0}}, {"Down", {0, 1, 0}}, {"Up", {0, -1, 0}}};
  for (const auto& [name, direction] : directions) {
    if (!text->starts_with(name)) continue;
    text->remove_prefix(name.size());
    return direction;
  }
  return std::nullopt;
}

// "XRightYUp": the directions in the image of the x and the y axis; the third axis makes the system right-handed, so it
// points forward or backward. https://developer.bentley.com/apis/contextcapture/cc-ori/ has the eight names.
std::optional<Eigen::Matrix3d> ExchangeAxes(std::string_view name) {
  if (!name.starts_with("X")) return std::nullopt;
  name.remove_prefix(1);
  const std::optional<Eigen::Vector3d> x = TakeExchangeDirection(&name);
  if (!x || !name.starts_with("Y")) return std::nullopt;
  name.remove_prefix(1);
  const std::optional<Eigen::Vector3d> y = TakeExchangeDirection(&name);
  if (!y || !name.empty() || x->dot(*y) != 0) return std::nullopt;
  Eigen::Matrix3d axes;
  axes << *x, *y, x->cross(*y);
  return axes;
}

bool ReadExchangeSize(const XmlNode& group, PinholeCamera* pinhole, Faults* faults) {
  const XmlNode size = group.Child("ImageDimensions");
  if (!size) {
    group.AddFault("no element ImageDimensions",
                   "the size of the photographs; export the block after aerotriangulation", faults);
    return false;
  }
  const std::optional<int64_t> width = size.ChildInteger("Width", faults), height = size.ChildInteger("Height", faults);
  if (!width || !height) return false;
  if (std::min(*width, *height) < 1 || std::max(*width, *height) > kMaxExchangeSide_px) {
    size.AddFault(absl::StrCat(*width, " x ", *height), absl::StrCat("1 to ", kMaxExchangeSide_px, " pixels"), faults);
    return false;
  }
  pinhole->width = static_cast<int>(*width);
  pinhole->height = static_cast<int>(*height);
  return true;
}

// f = FocalLengthPixels, or FocalLength (mm) by the size of a pixel: PixelSize, or SensorSize / max(w, h).
bool ReadExchangeFocalLength(const XmlNode& group, ExchangeCamera* result, Faults* faults) {
  PinholeCamera& pinhole = result->camera.lens.pinhole;
  const double mm = group.ChildNumberOr("FocalLength", 0, faults);
  const double sensor_mm = group.ChildNumberOr("SensorSize", 0, faults);
  double f = group.ChildNumberOr("FocalLengthPixels", 0, faults);
  result->pixel_mm = group.ChildNumberOr("PixelSize", sensor_mm / std::max(pinhole.width, pinhole.height), faults);
  if (f == 0 && result->pixel_mm > 0) f = mm / result->pixel_mm;
  if (result->pixel_mm == 0 && mm > 0 && f > 0) result->pixel_mm = mm / f;
  result->aspect_ratio = group.ChildNumberOr("AspectRatio", 1, faults);
  if (!(f > 0 && f < 1e9 && (result->pixel_mm == 0 || result->pixel_mm > 1e-9) && result->aspect_ratio > 0.01 &&
        result->aspect_ratio < 100)) {
    group.AddFault(absl::StrCat("FocalLength ", mm, ", SensorSize ", sensor_mm, ", FocalLengthPixels ", f,
                                ", AspectRatio ", result->aspect_ratio),
                   "FocalLength with SensorSize or PixelSize (mm), or FocalLengthPixels, positive", faults);
    return false;
  }
  pinhole.fx = f;
  pinhole.fy = f * result->aspect_ratio;
  return true;
}

}  // namespace

Eigen::Vector2d ExchangeCamera::PixelsOf(const Eigen::Vector2d& mm) const {
  return axes.topLeftCorner<2, 2>() * mm / pixel_mm;
}

// Documented in the cc-ori page above, and in the comments of ContextCapture's sample of Paris: the pixel position
// (0, 0) is the centre of the first pixel, so that .5 is added; PrincipalPoint in pixels is such a position, in
// millimetres (xmm, ymm) it is relative to the middle of the sensor, along CameraOrientation's axes. Distortion is
// Brown's model "as described in Wikipedia", where P1 belongs to r^2 + 2 x^2, unlike in OpenCV; it applies forward,
// from ideal to distorted positions, in the axes of the image.
bool ReadExchangeCamera(const XmlNode& group, ExchangeCamera* result, Faults* faults) {
  if (const std::string_view type = group.Child("CameraModelType").Text(); !type.empty() && type != "Perspective") {
    group.Child("CameraModelType")
        .AddFault(absl::StrCat("'", Printable(Prefix(type, 40)), "'"),
                  "Perspective; export undistorted photographs with their block", faults);
    return false;
  }
  result->camera.name = group.Child("Name").Text();
  PinholeCamera& pinhole = result->camera.lens.pinhole;
  if (!ReadExchangeSize(group, &pinhole, faults) || !ReadExchangeFocalLength(group, result, faults)) return false;
  if (const XmlNode orientation = group.Child("CameraOrientation"); orientation) {
    const std::optional<Eigen::Matrix3d> axes = ExchangeAxes(orientation.Text());
    if (!axes) {
      orientation.AddFault(
          absl::StrCat("'", Printable(Prefix(orientation.Text(), 40)), "'"),
          "XRightYDown, XRightYUp, XLeftYDown, XLeftYUp, XDownYRight, XDownYLeft, XUpYRight or XUpYLeft", faults);
      return false;
    }
    result->axes = *axes;
  }
  pinhole.cx = pinhole.width / 2.0;
  pinhole.cy = pinhole.height / 2.0;
  if (const XmlNode point = group.Child("PrincipalPoint"); point) {
    const bool in_mm = !point.Child("x") && point.Child("xmm");
    const std::optional<double> x = point.ChildNumber(in_mm ? "xmm" : "x", faults);
    const std::optional<double> y = point.ChildNumber(in_mm ? "ymm" : "y", faults);
    if (!x || !y) return false;
    if (in_mm && result->pixel_mm == 0) {
      point.AddFault("millimetres without the size of a pixel", "SensorSize or PixelSize in the photogroup", faults);
      return false;
    }
    const Eigen::Vector2d position =
        in_mm ? Eigen::Vector2d(Eigen::Vector2d(pinhole.cx, pinhole.cy) + result->PixelsOf({*x, *y}))
              : Eigen::Vector2d(*x + 0.5, *y + 0.5);
    pinhole.cx = position.x();
    pinhole.cy = position.y();
  }
  BrownLens brown;
  brown.skew_px = group.ChildNumberOr("Skew", 0, faults);
  if (const XmlNode distortion = group.Child("Distortion"); distortion) {
    brown.k1 = distortion.ChildNumberOr("K1", 0, faults);
    brown.k2 = distortion.ChildNumberOr("K2", 0, faults);
    brown.k3 = distortion.ChildNumberOr("K3", 0, faults);
    brown.p2 = distortion.ChildNumberOr("P1", 0, faults);
    brown.p1 = distortion.ChildNumberOr("P2", 0, faults);
  }
  SetBrownLens(brown, &result->camera.lens);
  return true;
}

}  // namespace tessera
