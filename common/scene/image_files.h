// Finds the files of images by the names in a camera model, which differ between programs and systems.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

struct ImageFiles {
  std::vector<std::string> files;                // of each name, relative to the images folder; empty if there is none
  int64_t other_case = 0;                        // names that differ from their file's in upper and lower case
  std::string other_case_name, other_case_file;  // the first of them
  std::vector<std::string> hints;                // of each name without a file: what is there instead; may be empty
};

// The name with '/' between folders, without "." and empty parts: "./a\b.jpg" becomes "a/b.jpg".
std::string PlainImageName(const std::string& name);

// Whether a file of a scene is an image, a mask or likelihoods, by the usual endings of their names. A file with
// another ending may be one, too.
bool IsPixelFile(const std::string& path);
// The last part of the path in lower case without these endings and ".mask". The files of one view have the same, if
// they are named as usual.
std::string PixelStem(const std::string& path);

// The file of a name is that with exactly this name, else with the plain name, else the only file whose name differs
// from the plain one in the case of ASCII letters. `exists`: whether the folder has a file of a name; thread-safe.
// `list`: all files of the folder; called at most once, if a name has no file.
ImageFiles FindImageFiles(const std::vector<std::string>& names, const std::function<bool(const std::string&)>& exists,
                          const std::function<std::vector<std::string>()>& list);

// The error for `missing` names of a model of `images` images in the folder at `path`: one message with the count, the
// first 20 names and what to do. `hints`: of `missing`.
Status MissingImagesError(const std::string& path, const std::vector<std::string>& missing,
                          const std::vector<std::string>& hints, size_t images);

}  // namespace tessera
