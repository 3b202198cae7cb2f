// Files that begin like images, for readers that need only their size.
#pragma once

#include <filesystem>
#include <fstream>
#include <string>

namespace tessera {

// A PNG of this size, cut after its header. Makes its folder.
inline void WriteImageHeader(const std::string& path, int width, int height) {
  std::filesystem::create_directories(std::filesystem::path(path).parent_path());
  std::string bytes("\x89PNG\r\n\x1a\n\0\0\0\rIHDR", 16);
  for (const int side : {width, height}) {
    for (int shift = 24; shift >= 0; shift -= 8) bytes += static_cast<char>(side >> shift & 255);
  }
  bytes += std::string("\x08\0\0\0\0\0\0\0\0", 9);  // 8 bits, grey; no checksum
  std::ofstream(path, std::ios::binary) << bytes;
}

}  // namespace tessera
