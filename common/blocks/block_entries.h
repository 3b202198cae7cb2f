// Parts that several readers of blocks share: sizes of photographs, lenses, rotations.
#pragma once

#include <Eigen/Core>
#include <array>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "common/blocks/block.h"
#include "common/blocks/block_parts.h"
#include "common/imaging/image_io.h"

namespace tessera {

// The size of the photograph at a path that is written in a block, for formats that state no sizes.
using PhotographSize = std::function<StatusOr<ImageSize>(const std::string& path)>;

// Finds the photographs of a block whose format states no image sizes. Not thread-safe.
class PhotographFiles {
 public:
  // `folder`: of the block. `images_folder`: of the photographs; may be empty.
  PhotographFiles(std::string folder, std::string images_folder)
      : folder_(std::move(folder)), images_folder_(std::move(images_folder)) {}

  // The file of the photograph that the block calls `path`: an existing path, absolute or in the block's folder; else
  // the file in images_folder, then in the block's folder, whose path ends with most parts of `path`. Backslashes
  // separate parts too. NOT_FOUND if there is none, INVALID_ARGUMENT if several match equally well.
  StatusOr<std::string> Find(const std::string& path);
  // The size of that file, as stored. Errors also as ReadImageHeader.
  StatusOr<ImageSize> SizeOf(const std::string& path);

 private:
  StatusOr<std::string> SearchImagesFolder(const std::vector<std::string>& parts);

  std::string folder_, images_folder_;
  std::optional<std::multimap<std::string, std::string>> images_;  // of images_folder_: paths by file name
};

// SetBrownLens on a camera with this pinhole; `radial`: k1 to k4.
LensModel MakeBrownLens(const PinholeCamera& pinhole, const std::array<double, 4>& radial, double p1, double p2,
                        double skew_px = 0);

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
