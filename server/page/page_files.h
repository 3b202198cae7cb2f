// The files of the page, which are part of the program.
#pragma once

#include <string_view>
#include <vector>

namespace tessera {

struct PageFile {
  std::string_view name;  // "index.html", "assets/main-ABCD.js"
  std::string_view gzip;  // its content, compressed; in the program's read-only data
};

// Sorted by name. Empty if the program was built without Node.js and npm. Thread-safe.
const std::vector<PageFile>& PageFiles();

}  // namespace tessera
