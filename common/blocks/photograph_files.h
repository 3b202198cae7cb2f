// Finds the photographs of a block on this machine: for the scene, and for formats that state no image sizes.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/image_io.h"

namespace tessera {

struct PathReplacement {
  std::string from, to;  // the beginning of a path in the source, and what replaces it
};

// Reads "OLD=NEW", the value of --image-path. INVALID_ARGUMENT without '=' or with an empty part.
StatusOr<PathReplacement> ParsePathReplacement(const std::string& text);

// Where the user says that photographs lie.
struct PhotographSearch {
  std::vector<std::string> folders = {};           // --images: where to search; empty: beside the source
  std::vector<PathReplacement> replacements = {};  // --image-path
};

// The path with '/' between folders, without "file://".
std::string PlainPath(const std::string& path);
// The names of its folders and of its file.
std::vector<std::string> PathParts(const std::string& path);
// Whether a name ends as those of images. Programs may name photographs by labels, which are names without extension.
bool IsImageName(const std::string& name);
// The source itself, if it is a folder, else the folder that it lies in. Absolute.
std::string FolderOfSource(const std::string& source);

// Files of images in folders.
class ImageIndex {
 public:
  // Adds the images in `folder` at any depth, among its first `max_entries` entries. Leaves out what cannot be read,
  // and scenes of earlier imports, which have the same images.
  void AddFolder(const std::string& folder, int64_t max_entries);
  struct Matches {
    std::vector<std::string> files;  // sorted
    size_t common = 0;               // how many names at the ends of the paths are equal
  };
  // The files whose paths have the longest common end with `parts`, in whole names, ignoring case; none if no last name
  // is equal. A last part without an image's extension stands for one with any.
  Matches Longest(const std::vector<std::string>& parts) const;

 private:
  std::map<std::string, std::vector<std::string>> files_, by_stem_;  // by the lower case of the last name
};

// The photographs of one block. Not thread-safe.
class PhotographFiles {
 public:
  // `source`: the block's file or folder.
  PhotographFiles(const std::string& source, PhotographSearch search);
  // The file of the photograph that the block calls `path`: the path after the longest replacement that fits, or as it
  // is, relative to the source's folder, if there is such a file; else ImageIndex::Longest in the searched folders.
  // NOT_FOUND if there is none, INVALID_ARGUMENT if several have equal right.
  StatusOr<std::string> Find(const std::string& path);
  // The size of that file, as stored. Errors also as ReadImageHeader.
  StatusOr<ImageSize> SizeOf(const std::string& path);

 private:
  std::string PathHere(const std::string& path) const;

  std::string source_folder_;
  PhotographSearch search_;
  std::optional<ImageIndex> index_;  // made when the first path is no file
};

// PhotographFiles::SizeOf, for parsers, which have no files.
using PhotographSize = std::function<StatusOr<ImageSize>(const std::string& path)>;

}  // namespace tessera
