#include "common/synth/labels/label_noise.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/base/parallel.h"
#include "common/base/random.h"
#include "common/synth/noise.h"

namespace tessera {
namespace {

constexpr float kSharedDeviation = 0.62f;  // weight of the doubt that all views share; the total variance is 1

// Two passes of a separable box blur approximate a Gaussian.
void BlurPlane(float* plane, int width, int height, int radius) {
  std::vector<float> line(std::max(width, height));
  const auto blur = [&](float* first, int count, int stride) {
    for (int k = 0; k < count; ++k) line[k] = first[static_cast<size_t>(k) * stride];
    for (int k = 0; k < count; ++k) {
      float sum = 0;
      for (int d = -radius; d <= radius; ++d) sum += line[std::clamp(k + d, 0, count - 1)];
      first[static_cast<size_t>(k) * stride] = sum / static_cast<float>(2 * radius + 1);
    }
  };
  for (int pass = 0; pass < 2; ++pass) {
    for (int y = 0; y < height; ++y) blur(plane + static_cast<size_t>(y) * width, width, 1);
    for (int x = 0; x < width; ++x) blur(plane + x, height, width);
  }
}

}  // namespace

int32_t ConfusedClass(int32_t label, float choice) {
  switch (label) {
    case kGround:
      return choice < 0.55f ? kRoof : choice < 0.85f ? kVegetation : kFacade;
    case kFacade:
      return choice < 0.75f ? kRoof : kVegetation;
    case kRoof:
      return choice < 0.5f ? kGround : choice < 0.95f ? kFacade : kVegetation;
    default:
      return choice < 0.8f ? kGround : kRoof;
  }
}

LabelDoubt SurfaceDoubt(const Eigen::Vector3d& p, double scale_m, uint32_t seed) {
  const Eigen::Vector3d a = p / (2.2 * scale_m), b = p / (6.0 * scale_m);
  const float sum = 0.75f * ValueNoise3(a.x(), a.y(), a.z(), seed) + 0.8f * ValueNoise3(b.x(), b.y(), b.z(), seed + 1);
  const Eigen::Vector3d c = p / (7.0 * scale_m);
  const float choice = 0.5f + 0.6f * ValueNoise3(c.x(), c.y(), c.z(), seed + 2);
  return {sum / (1.097f * kValueNoise3Deviation), std::clamp(choice, 0.f, 0.999f)};
}

ViewDoubt PixelDoubt(const CityPlan& plan, const RenderedView& view, uint64_t view_seed) {
  const int width = view.labels.width, height = view.labels.height;
  ViewDoubt out{FloatImage(width, height), FloatImage(width, height)};
  const uint32_t own = static_cast<uint32_t>(MixBits(view_seed ^ 0x626c6f6273ull));
  const uint32_t shared = static_cast<uint32_t>(MixBits(plan.seed ^ 0x736861726564ull));
  const float own_weight = std::sqrt(1 - kSharedDeviation * kSharedDeviation) / (1.09f * kValueNoise2Deviation);
  const double unit = std::max(0.35, width / 1000.0);  // blobs scale with the image
  ParallelForEach(height, 8, [&](int y) {
    for (int x = 0; x < width; ++x) {
      if (view.labels.at(x, y) == 255) continue;
      const Eigen::Vector3d p(view.position.at(x, y, 0), view.position.at(x, y, 1), view.position.at(x, y, 2));
      const LabelDoubt common = SurfaceDoubt(p, 1.1, shared);
      const double u = x / unit, v = y / unit;
      const float noise = 0.5f * ValueNoise2(u / 7, v / 7, own) + 0.75f * ValueNoise2(u / 19, v / 19, own + 1) +
                          0.62f * ValueNoise2(u / 55, v / 55, own + 2);
      out.doubt.at(x, y) = own_weight * noise + kSharedDeviation * common.doubt;
      const float choice = 0.5f * common.choice + 0.5f * (0.5f + 0.7f * ValueNoise2(u / 40, v / 40, own + 3));
      // The mean of two uniform values concentrates around 0.5, so stretch it.
      out.choice.at(x, y) = std::clamp(0.5f + 1.6f * (choice - 0.5f), 0.f, 0.999f);
    }
  });
  return out;
}

ByteImage MakeLikelihoods(const RenderedView& view, const ViewDoubt& doubt, double threshold) {
  const int width = view.labels.width, height = view.labels.height;
  FloatImage belief(width, height, kCityClasses);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const int label = view.labels.at(x, y);
      if (label == 255) {
        for (int c = 0; c < kCityClasses; ++c) belief.at(x, y, c) = 1.f / kCityClasses;
        continue;
      }
      // The probability changes smoothly from the true to the confused class; both are equal at the threshold.
      const float wrong = 1.f / (1.f + std::exp(-4.f * (doubt.doubt.at(x, y) - static_cast<float>(threshold))));
      belief.at(x, y, label) += 1.f - wrong;
      belief.at(x, y, ConfusedClass(label, doubt.choice.at(x, y))) += wrong;
    }
  }
  const int radius = std::max(1, static_cast<int>(std::lround(2.0 * width / 1000.0)));
  ParallelForEach(kCityClasses, 1, [&](int c) { BlurPlane(belief.plane(c), width, height, radius); });
  ByteImage out(width, height, kCityClasses);
  ParallelForEach(height, 16, [&](int y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < kCityClasses; ++c) {
        // At most 0.84, so that no class is certain. 64 steps suffice and keep the files small.
        const float p = 0.04f + 0.8f * belief.at(x, y, c);
        out.at(x, y, c) = static_cast<uint8_t>(4 * std::lround(63.f * std::clamp(p, 0.f, 1.f)));
      }
    }
  });
  return out;
}

ArgmaxCount CountArgmax(const RenderedView& view, const ByteImage& likelihoods) {
  ArgmaxCount count;
  for (int y = 0; y < view.labels.height; ++y) {
    for (int x = 0; x < view.labels.width; ++x) {
      const int label = view.labels.at(x, y);
      if (label == 255) continue;
      int best = 0;
      for (int c = 1; c < kCityClasses; ++c) {
        if (likelihoods.at(x, y, c) > likelihoods.at(x, y, best)) best = c;
      }
      ++count.all;
      count.right += best == label;
    }
  }
  return count;
}

}  // namespace tessera
