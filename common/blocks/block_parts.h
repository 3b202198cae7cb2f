// What readers of blocks share: lenses, cameras, the check of rotations, the choice of a component.
#pragma once

#include <Eigen/Core>
#include <array>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "common/blocks/block.h"

namespace tessera {

// For x, y = the undistorted position divided by the depth, r^2 = x^2 + y^2:
//   x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8) + 2 p1 x y + p2 (r^2 + 2 x^2)
//   y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8) + 2 p2 x y + p1 (r^2 + 2 y^2)      (p1, p2 as in OpenCV)
//   u = cx + fx x' + skew y',  v = cy + fy y'
struct BrownLens {
  double k1 = 0, k2 = 0, k3 = 0, k4 = 0, p1 = 0, p2 = 0, skew_px = 0;
};

// Sets the kind and the coefficients of `lens`, whose pinhole is set: the simplest of COLMAP's models that has all
// terms, else kBrown.
void SetBrownLens(const BrownLens& brown, LensModel* lens);

// A reading in which p1 and p2 of all cameras are exchanged.
BlockReading ExchangedTangentialReading();

// Whether any camera has p1 or p2.
bool HasTangential(const ImportedBlock& block);

// Replaces `rotation` by the nearest rotation. False if it differs from a rotation by more than 1e-3 in an element of
// R R^T, or mirrors.
bool MakeRotation(Eigen::Matrix3d* rotation);

// Removes observations in images without a pose and points that have no observation then. Returns the number of removed
// observations.
int64_t DropUnorientedObservations(const ImportedBlock& block, std::vector<BlockTiePoint>* points);

// The component to read: `wanted`, or if that is negative the one with most oriented images, the smallest of equals;
// -1, which stands for images of no component, only if there is no other. Images of other components become not
// oriented; adds a line to left_out for them. A fault of `path` if no oriented image has the component, or
// if no image is oriented and there is no other fault.
void ChooseComponent(int wanted, const std::string& path, ImportedBlock* block, Faults* faults);

// SetBrownLens on a camera with this pinhole; `radial`: k1 to k4.
LensModel MakeBrownLens(const PinholeCamera& pinhole, const std::array<double, 4>& radial, double p1, double p2,
                        double skew_px = 0);

// The fault of the image at `path` in the block, whose format states no size: `error` of PhotographSize. `location`: of
// the image in `file`. Without a file the path becomes one of block->missing_images.
Status ImageSizeFault(const std::string& file, const std::string& location, const std::string& path,
                      const Status& error, ImportedBlock* block);

// Cameras of a block; images with equal lenses share one.
class SharedCameras {
 public:
  explicit SharedCameras(ImportedBlock* block) : block_(*block) {}
  // Index of the camera with this lens, all numbers finite. Adds the camera `name` if there is none.
  int IndexOf(const LensModel& lens, const std::string& name);

 private:
  ImportedBlock& block_;
  std::map<std::array<double, 15>, int> indices_;
};

// `text` starts with UTF-8's byte order mark: removes it.
std::string_view WithoutByteOrderMark(std::string_view text);

}  // namespace tessera
