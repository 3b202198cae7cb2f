// Value noise on integer lattices: random values as a function of position, for textures, terrain and label errors.
#pragma once

#include <cmath>
#include <cstdint>

namespace tessera {

// A hash of an integer lattice point; equal on all machines.
inline uint32_t HashLattice(int32_t x, int32_t y, int32_t z, uint32_t seed) {
  uint32_t h = seed ^ (static_cast<uint32_t>(x) * 0x8da6b343u) ^ (static_cast<uint32_t>(y) * 0xd8163841u) ^
               (static_cast<uint32_t>(z) * 0xcb1ab31fu);
  h ^= h >> 15;
  h *= 0x2c1b3c6du;
  h ^= h >> 12;
  h *= 0x297a2d39u;
  h ^= h >> 15;
  return h;
}

// Uniform in [-1, 1), one value per lattice point.
inline float LatticeValue(int32_t x, int32_t y, int32_t z, uint32_t seed) {
  return static_cast<float>(static_cast<int32_t>(HashLattice(x, y, z, seed))) * 0x1.0p-31f;
}

// Uniform in [0, 1), one value per lattice point.
inline float LatticeUniform(int32_t x, int32_t y, int32_t z, uint32_t seed) {
  return static_cast<float>(HashLattice(x, y, z, seed) >> 8) * 0x1.0p-24f;
}

inline float SmoothStep(float t) { return t * t * (3.f - 2.f * t); }

// Smooth noise of wavelength about 2 lattice units in [-1, 1]; standard deviation kValueNoise2Deviation.
inline float ValueNoise2(double x, double y, uint32_t seed) {
  const double fx = std::floor(x), fy = std::floor(y);
  const int32_t ix = static_cast<int32_t>(fx), iy = static_cast<int32_t>(fy);
  const float u = SmoothStep(static_cast<float>(x - fx)), v = SmoothStep(static_cast<float>(y - fy));
  const float a = LatticeValue(ix, iy, 0, seed), b = LatticeValue(ix + 1, iy, 0, seed);
  const float c = LatticeValue(ix, iy + 1, 0, seed), d = LatticeValue(ix + 1, iy + 1, 0, seed);
  const float low = a + (b - a) * u, high = c + (d - c) * u;
  return low + (high - low) * v;
}

inline float ValueNoise3(double x, double y, double z, uint32_t seed) {
  const double fz = std::floor(z);
  const uint32_t iz = static_cast<uint32_t>(static_cast<int32_t>(fz));
  const float w = SmoothStep(static_cast<float>(z - fz));
  const float low = ValueNoise2(x, y, seed ^ (iz * 0xcb1ab31fu));
  const float high = ValueNoise2(x, y, seed ^ ((iz + 1) * 0xcb1ab31fu));
  return low + (high - low) * w;
}

inline constexpr float kValueNoise2Deviation = 0.43f;
inline constexpr float kValueNoise3Deviation = 0.37f;

}  // namespace tessera
