// The contents of a folder, for comparison.
#pragma once

#include <map>
#include <string>

#include "common/storage/files.h"

namespace tessera {

// The contents of all files below `folder`, by relative path.
inline std::map<std::string, std::string> AllFiles(const std::string& folder) {
  std::map<std::string, std::string> content;
  const auto names = ListFiles(folder);
  for (const std::string& name : *names) content[name] = *ReadFile(folder + "/" + name);
  return content;
}

}  // namespace tessera
