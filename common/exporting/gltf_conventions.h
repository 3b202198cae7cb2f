// What the writers of glTF 2.0 share: its constants, axes and colours.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>

namespace tessera {

inline constexpr int kGltfUint16 = 5123, kGltfUint32 = 5125, kGltfFloat = 5126;
inline constexpr int kGltfArrayBuffer = 34962, kGltfIndexBuffer = 34963;
inline constexpr uint32_t kGlbMagic = 0x46546c67, kGlbJsonChunk = 0x4e4f534a, kGlbBinaryChunk = 0x004e4942;

// East-north-up to glTF, whose y is up.
template <class T>
Eigen::Matrix<T, 3, 1> GltfFromEnu(const Eigen::Matrix<T, 3, 1>& p) {
  return {p.x(), p.z(), -p.y()};
}

// Linear light in [0, 1] of an sRGB value (IEC 61966-2-1); glTF's colours are linear.
inline double LinearLight(uint8_t srgb) {
  const double value = srgb / 255.0;
  return value <= 0.04045 ? value / 12.92 : std::pow((value + 0.055) / 1.055, 2.4);
}

// The same as a fraction in 16 bits, normalized.
inline uint16_t LinearLight16(uint8_t srgb) { return static_cast<uint16_t>(std::lround(65535 * LinearLight(srgb))); }

}  // namespace tessera
