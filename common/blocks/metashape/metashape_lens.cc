#include "common/blocks/metashape/metashape_lens.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "common/base/printable.h"
#include "common/blocks/block_parts.h"

namespace tessera {
namespace {

constexpr int64_t kMaxMetashapeSide_px = 1'000'000;

bool ReadMetashapeSize(const XmlNode& node, int* width, int* height, Faults* faults) {
  const std::optional<int64_t> w = node.IntegerAttribute("width", faults), h = node.IntegerAttribute("height", faults);
  if (!w || !h) return false;
  if (std::min(*w, *h) < 1 || std::max(*w, *h) > kMaxMetashapeSide_px) {
    node.AddFault(absl::StrCat(*w, " x ", *h), absl::StrCat("1 to ", kMaxMetashapeSide_px, " pixels"), faults);
    return false;
  }
  *width = static_cast<int>(*w);
  *height = static_cast<int>(*h);
  return true;
}

// The adjusted calibration, else the initial one, else the first.
XmlNode BestCalibration(const XmlNode& sensor) {
  for (const char* wanted : {"adjusted", "initial"}) {
    for (XmlNode item = sensor.Child("calibration"); item; item = item.Next("calibration")) {
      if (item.Attribute("class") == wanted) return item;
    }
  }
  return sensor.Child("calibration");
}

}  // namespace

// Metashape's manual, appendix "Camera models", frame cameras, for x, y = position / depth, x right, y down; the centre
// of the first pixel is (0.5, 0.5):
//   x' = x (1 + K1 r^2 + K2 r^4 + K3 r^6 + K4 r^8) + P1 (r^2 + 2 x^2) + 2 P2 x y
//   y' = y (1 + K1 r^2 + K2 r^4 + K3 r^6 + K4 r^8) + P2 (r^2 + 2 y^2) + 2 P1 x y
//   u = w / 2 + cx + x' f + x' B1 + y' B2,  v = h / 2 + cy + y' f
// P1 and P2 change places against OpenCV. PhotoScan before 1.3 writes <fx>, <fy>, <skew>; cx, cy count from the corner
// and P1, P2 are as in OpenCV (its manual: x' = ... + P2 (r^2 + 2 x^2) + 2 P1 x y).
bool ReadMetashapeSensor(const XmlNode& sensor, BlockCamera* camera, bool* old_form, Faults* faults) {
  camera->name = sensor.Attribute("label").value_or("");
  PinholeCamera& pinhole = camera->lens.pinhole;
  const XmlNode calibration = BestCalibration(sensor);
  for (const XmlNode& node : {sensor, calibration}) {
    const std::string_view type = node.Attribute("type").value_or("frame");
    if (type == "frame") continue;
    node.AddFault(absl::StrCat("a camera of type '", Printable(Prefix(type, 40)), "'"),
                  "frame; export undistorted photographs and their cameras", faults);
    return false;
  }
  if (!calibration) {
    sensor.AddFault("no calibration", "one; align the photographs before the export", faults);
    return false;
  }
  const XmlNode size = sensor.Child("resolution"), calibrated_size = calibration.Child("resolution");
  if (!ReadMetashapeSize(size ? size : calibrated_size, &pinhole.width, &pinhole.height, faults)) return false;
  int width = pinhole.width, height = pinhole.height;
  if (calibrated_size && !ReadMetashapeSize(calibrated_size, &width, &height, faults)) return false;
  if (width != pinhole.width || height != pinhole.height) {
    calibrated_size.AddFault(absl::StrCat("a calibration for ", width, " x ", height, " pixels"),
                             absl::StrCat(pinhole.width, " x ", pinhole.height, " as the sensor"), faults);
    return false;
  }
  const auto value = [&](const char* name) { return calibration.ChildNumberOr(name, 0, faults); };
  BrownLens brown{.k1 = value("k1"), .k2 = value("k2"), .k3 = value("k3"), .k4 = value("k4")};
  *old_form = !calibration.Child("f") && calibration.Child("fx");
  if (*old_form) {
    pinhole.fx = value("fx");
    pinhole.fy = calibration.ChildNumberOr("fy", pinhole.fx, faults);
    pinhole.cx = calibration.ChildNumberOr("cx", pinhole.width / 2.0, faults);
    pinhole.cy = calibration.ChildNumberOr("cy", pinhole.height / 2.0, faults);
    brown.skew_px = value("skew");
    brown.p1 = value("p1");
    brown.p2 = value("p2");
  } else {
    pinhole.fy = value("f");
    pinhole.fx = pinhole.fy + value("b1");
    pinhole.cx = pinhole.width / 2.0 + value("cx");
    pinhole.cy = pinhole.height / 2.0 + value("cy");
    brown.skew_px = value("b2");
    brown.p1 = value("p2");
    brown.p2 = value("p1");
  }
  if (!(std::min(pinhole.fx, pinhole.fy) > 0 && std::max(pinhole.fx, pinhole.fy) < 1e9)) {
    calibration.AddFault(absl::StrCat("a focal length of ", pinhole.fx, " and ", pinhole.fy, " pixels"),
                         "a positive one in f, or fx and fy", faults);
    return false;
  }
  if (value("p3") != 0 || value("p4") != 0) {
    calibration.AddFault("p3 and p4", "p1 and p2 only; optimize the cameras without p3 and p4", faults);
    return false;
  }
  SetBrownLens(brown, &camera->lens);
  return true;
}

}  // namespace tessera
