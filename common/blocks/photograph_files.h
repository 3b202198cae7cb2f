// Finds the photographs of blocks whose formats state no image sizes.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"
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

}  // namespace tessera
