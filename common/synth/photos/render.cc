#include "common/synth/photos/render.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/base/parallel.h"
#include "common/base/random.h"
#include "common/synth/noise.h"

namespace tessera {
namespace {

constexpr int kSamples = 4;
constexpr float kVignetting = 0.22f;  // relative loss in the corners
constexpr float kNoise = 1.6f;        // standard deviation of sensor noise at mid grey, grey levels

float Encode(float linear) { return 255.f * std::pow(std::min(std::max(linear, 0.f), 1.f), 1.f / 2.2f); }

// Approximately standard normal.
float PixelNoise(int x, int y, int k, uint32_t seed) {
  return (LatticeValue(x, y, 4 * k, seed) + LatticeValue(x, y, 4 * k + 1, seed) + LatticeValue(x, y, 4 * k + 2, seed));
}

}  // namespace

RenderedView RenderView(const CityScene& scene, const SynthView& view, uint64_t seed, bool with_rgb) {
  const PosedCamera& camera = view.camera;
  const int width = camera.intrinsics.width, height = camera.intrinsics.height;
  RenderedView out;
  out.labels = LabelImage(width, height, 1, 255);
  out.position = FloatImage(width, height, 3);
  if (with_rgb) out.rgb = ByteImage(width, height, 3);
  const Eigen::Vector3d centre = camera.Centre();
  const uint32_t noise_seed = static_cast<uint32_t>(MixBits(seed ^ 0x6e6f697365ull));
  Random random(seed ^ 0x6578706f73757265ull);
  const float exposure = static_cast<float>(1.15 * std::exp(0.1 * random.Uniform(-1, 1)));
  std::array<float, 3> balance;
  for (float& b : balance) b = static_cast<float>(random.Uniform(0.97, 1.03));
  const Eigen::Vector3f haze(0.5f, 0.56f, 0.62f);
  const double half_diagonal = 0.5 * std::hypot(width, height);
  ParallelForEach(height, 4, [&](int y) {
    for (int x = 0; x < width; ++x) {
      const Eigen::Vector3d middle = camera.Ray(x + 0.5, y + 0.5);
      const RayHit hit = scene.caster().Cast(centre, middle);
      if (hit.hit()) {
        out.labels.at(x, y) = static_cast<uint8_t>(scene.surface().mesh.labels[hit.face]);
        const Eigen::Vector3d p = centre + hit.distance * middle;
        for (int k = 0; k < 3; ++k) out.position.at(x, y, k) = static_cast<float>(p[k]);
      }
      if (!with_rgb) continue;
      Eigen::Vector3f sum = hit.hit() ? scene.Radiance(hit, centre, middle) : haze;
      // Three more rays on a randomly rotated circle around the centre, which sample the pixel evenly.
      const double turn = LatticeUniform(x, y, 99, noise_seed) * 6.283185307179586;
      for (int k = 1; k < kSamples; ++k) {
        const double angle = turn + (k - 1) * 2.0943951023931953, radius = 0.4;
        const Eigen::Vector3d ray = camera.Ray(x + 0.5 + radius * std::cos(angle), y + 0.5 + radius * std::sin(angle));
        const RayHit sample = scene.caster().Cast(centre, ray);
        sum += sample.hit() ? scene.Radiance(sample, centre, ray) : haze;
      }
      const double r = std::hypot(x + 0.5 - camera.intrinsics.cx, y + 0.5 - camera.intrinsics.cy) / half_diagonal;
      const float gain = exposure * (1.f - kVignetting * static_cast<float>(r * r)) / kSamples;
      for (int k = 0; k < 3; ++k) {
        const float value = Encode(sum[k] * gain * balance[k]);
        const float noise = kNoise * std::sqrt(0.4f + value / 210.f) * PixelNoise(x, y, k, noise_seed);
        out.rgb.at(x, y, k) = static_cast<uint8_t>(std::lround(std::min(255.f, std::max(0.f, value + noise))));
      }
    }
  });
  return out;
}

}  // namespace tessera
