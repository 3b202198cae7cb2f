// Values as the bytes of files.
#pragma once

#include <algorithm>
#include <string>
#include <vector>

namespace tessera::bent {

// Little-endian, as on this machine.
template <class T>
std::string Raw(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

template <class T>
std::string RawBigEndian(T value) {
  std::string bytes = Raw<T>({value});
  std::reverse(bytes.begin(), bytes.end());
  return bytes;
}

}  // namespace tessera::bent
