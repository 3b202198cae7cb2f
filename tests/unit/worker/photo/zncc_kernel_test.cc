#include "worker/photo/zncc_kernel.h"

#include <gtest/gtest.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "common/base/random.h"
#include "tests/support/make_texels.h"
#include "tests/unit/worker/photo/zncc_oracle.h"
#include "worker/photo/photo_term.h"

namespace tessera {
namespace {

// Restricts the kernels to one instruction set during its lifetime.
class OnTarget {
 public:
  explicit OnTarget(int64_t target) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  }
  ~OnTarget() {
    hwy::SetSupportedTargetsForTest(0);
    hwy::GetChosenTarget().DeInit();
  }
};

bool Supports(int64_t target) { return (hwy::SupportedTargets() & target) != 0 || target == HWY_SCALAR; }

std::vector<int64_t> Targets() {
  std::vector<int64_t> out;
  for (const int64_t target : {HWY_AVX3, HWY_AVX2, HWY_SSE4, HWY_SCALAR}) {
    if (Supports(target)) out.push_back(target);
  }
  return out;
}

struct Setting {
  int width = 40, height = 14, radius = 3, classes = 0;
  float photo_outlier = std::numeric_limits<float>::infinity();
  bool gaussian = true;
  uint64_t seed = 1;
};

// A random pair: noise images and classes, random depth per pixel, partly occluded surfaces.
class RandomPair {
 public:
  // `used(x, y)`: whether the reference uses a pixel.
  template <class Used>
  RandomPair(const Setting& setting, const Used& used) : setting_(setting), random_(setting.seed) {
    const int w = setting.width, h = setting.height;
    reference_ = Image(w, h);
    // The other image is larger and partly invalid.
    other_ = Image(w + 5, h + 3);
    FaceMap map;
    map.width = other_.width;
    map.height = other_.height;
    map.depth.resize(static_cast<size_t>(map.width) * map.height);
    map.face.assign(map.depth.size(), 0);
    for (float& depth : map.depth) {
      const double kind = Uniform();
      depth = kind < 0.1 ? FaceMap::kNothing : kind < 0.2 ? 8.0f : 11.0f;
    }
    SetWarpTarget(other_, map, {}, &target_);
    pair.reference = &reference_;
    pair.other = &target_;
    pair.depth_slack = 0.01f;
    // A few pixels of parallax, some rotation and perspective: u = (q0, q1) / q2 is near (x + 2, y + 1).
    const float m[9] = {1.01f, 0.04f, 0.3f, -0.05f, 0.98f, 0.4f, 0.0004f, -0.0003f, 1};
    const float t[3] = {14, 6, 0.05f};
    std::copy_n(m, 9, pair.m);
    std::copy_n(t, 3, pair.t);
    whole.Reset(w, h, setting.radius, 0, h);
    for (int y = 0; y < h; ++y) {
      for (int x = 0; x < whole.depth.stride; ++x) {
        const bool in = x < w && used(x, y);
        whole.depth.row(y)[x] = static_cast<float>(10 + 0.4 * Uniform());
        whole.depth_factor.row(y)[x] = in ? static_cast<float>(-0.5 - Uniform()) : 0;
      }
    }
    window = MakeWindow(2 * setting.radius + 1, setting.gaussian);
    window.min_valid = 0.4371f;
    window.epsilon = 1e-4f;
    window.noise_variance = 0.01f;
    window.max_mean_difference = 1;
    window.max_variance_ratio = 1e6f;
    window.min_variance = -1;
    window.outlier = setting.photo_outlier;
    semantic_weight = setting.classes > 0 ? 0.7f : 0.0f;
    RemoveAmbiguousPixels();
  }

  ZnccOracle<double> Expected() const {
    ZnccOracle<double> oracle(pair, window, semantic_weight, whole);
    oracle.Run();
    return oracle;
  }

  // Runs the kernel on rows [begin, end).
  ReferenceStrip Run(int begin, int end, ZnccSums* sums) const {
    ReferenceStrip strip;
    strip.Reset(setting_.width, setting_.height, setting_.radius, begin, end);
    for (int y = strip.depth.first_row; y < strip.depth.first_row + strip.depth.rows; ++y) {
      std::copy_n(whole.depth.row(y), strip.depth.stride, strip.depth.row(y));
      std::copy_n(whole.depth_factor.row(y), strip.depth.stride, strip.depth_factor.row(y));
    }
    ZnccScratch scratch;
    SummarizeReference(reference_, window, &strip, &scratch);
    *sums = AccumulateZncc(pair, window, semantic_weight, &strip, &scratch);
    return strip;
  }
  ReferenceStrip Run(ZnccSums* sums) const { return Run(0, setting_.height, sums); }

  ZnccPair pair;
  ZnccWindow window;
  float semantic_weight = 0;
  ReferenceStrip whole;

 private:
  double Uniform() { return random_.Uniform(); }

  Texels Image(int w, int h) {
    FloatImage luminance(w, h), likelihoods(w, h, std::max(setting_.classes, 1));
    for (float& value : luminance.data) value = Uniform() < 0.02 ? std::nanf("") : static_cast<float>(Uniform());
    for (float& value : likelihoods.data) value = static_cast<float>(Uniform());
    return setting_.classes > 0 ? MakeTexels(luminance, likelihoods, PixelMapping()) : MakeTexels(luminance);
  }

  // Excludes pixels whose decisions depend on rounding.
  void RemoveAmbiguousPixels() {
    ZnccOracle<double> oracle(pair, window, semantic_weight, whole);
    oracle.hair = 1e-4;
    oracle.Run();
    for (int i : oracle.doubtful) whole.depth_factor.row(i / setting_.width)[i % setting_.width] = 0;
    for (int y = 0; y < setting_.height; ++y) {
      for (int x = 0; x < setting_.width; ++x) {
        if (!reference_.Valid(x, y)) whole.depth_factor.row(y)[x] = 0;
      }
    }
  }

  Setting setting_;
  Random random_;
  Texels reference_, other_;
  WarpTarget target_;
};

// Largest difference over a plane relative to its root mean square, or to 1 if that is 0.
double Difference(const PaddedPlane& got, const std::vector<double>& expected, int width) {
  double worst = 0, sum = 0;
  for (size_t i = 0; i < expected.size(); ++i) {
    const int x = static_cast<int>(i) % width, y = static_cast<int>(i) / width;
    worst = std::max(worst, std::abs(static_cast<double>(got.row(y)[x]) - expected[i]));
    sum += expected[i] * expected[i];
  }
  const double rms = std::sqrt(sum / static_cast<double>(expected.size()));
  return rms > 0 ? worst / rms : worst;
}

void ExpectAgreement(const RandomPair& input, const Setting& setting) {
  const ZnccOracle<double> expected = input.Expected();
  for (const int64_t target : Targets()) {
    const OnTarget on(target);
    ZnccSums sums;
    const ReferenceStrip got = input.Run(&sums);
    SCOPED_TRACE(testing::Message() << hwy::TargetName(target) << " width " << setting.width << " radius "
                                    << setting.radius << " classes " << setting.classes << " seed " << setting.seed);
    ASSERT_LT(Difference(got.gradient, expected.gradient, setting.width), 1e-3);
    ASSERT_LT(Difference(got.curvature, expected.curvature, setting.width), 1e-3);
    ASSERT_EQ(Difference(got.count, expected.count, setting.width), 0);
    ASSERT_EQ(sums.windows, expected.sums.windows);
    ASSERT_EQ(sums.semantic_pixels, expected.sums.semantic_pixels);
    ASSERT_NEAR(sums.energy, expected.sums.energy, 1e-5 * (1 + expected.sums.energy));
    ASSERT_NEAR(sums.weight, expected.sums.weight, 1e-5 * (1 + expected.sums.weight));
    ASSERT_NEAR(sums.semantic_energy, expected.sums.semantic_energy, 1e-5 * (1 + expected.sums.semantic_energy));
  }
}

TEST(ZnccKernel, MatchesPlainLoopsAtEveryWidth) {
  int64_t windows = 0, pixels = 0;
  for (int width = 1; width <= 53; ++width) {
    for (double share : {1.0, 0.8, 0.3}) {
      Setting setting;
      setting.width = width;
      setting.classes = width % 10;
      setting.radius = 1 + width % 5;
      setting.gaussian = width % 3 != 0;
      setting.seed = 100 + width;
      if (width % 4 == 1) setting.photo_outlier = 0.4f;
      Random random(width);
      const RandomPair input(setting, [&](int, int) { return random.Uniform() < share; });
      ExpectAgreement(input, setting);
      windows += input.Expected().sums.windows;
      pixels += input.Expected().sums.semantic_pixels;
    }
  }
  EXPECT_GT(windows, 5000);
  EXPECT_GT(pixels, 10000);
}

TEST(ZnccKernel, MatchesPlainLoopsForEveryRadiusAndNumberOfClasses) {
  for (int radius = 1; radius <= ZnccWindow::kMaxRadius; ++radius) {
    for (int classes : {0, 1, 2, 3, 4, 5, 8, 9, 13}) {
      Setting setting;
      setting.radius = radius;
      setting.classes = classes;
      setting.width = 37;
      setting.height = 25;
      setting.photo_outlier = classes % 2 ? 0.5f : setting.photo_outlier;
      ExpectAgreement(RandomPair(setting, [](int, int) { return true; }), setting);
    }
  }
}

TEST(ZnccKernel, MatchesPlainLoopsForEveryMask) {
  // All masks of two rows of five pixels in the middle of an image that is otherwise used, or unused.
  for (int pattern = 0; pattern < 1024; ++pattern) {
    Setting setting;
    setting.width = 21;
    setting.height = 8;
    setting.radius = 1 + pattern % 3;
    setting.classes = pattern % 2;
    setting.seed = 7 + pattern % 11;
    const bool rest = pattern / 2 % 2 == 0;
    const RandomPair input(setting, [&](int x, int y) {
      const bool inside = x >= 13 && x < 18 && y >= 3 && y < 5;
      return inside ? (pattern >> ((y - 3) * 5 + x - 13) & 1) != 0 : rest;
    });
    ASSERT_NO_FATAL_FAILURE(ExpectAgreement(input, setting));
  }
}

// A wide pair with empty parts, which covers every branch of the kernel.
RandomPair WidePair(int classes) {
  Setting setting;
  setting.width = 611;
  setting.height = 90;
  setting.classes = classes;
  setting.photo_outlier = 0.7f;
  return RandomPair(setting, [](int x, int y) { return (x / 90 + y / 40) % 3 != 0; });
}

TEST(ZnccKernel, StripsAddUpToTheWhole) {
  const RandomPair input = WidePair(3);
  ZnccSums sums, parts;
  const ReferenceStrip whole = input.Run(&sums);
  for (int begin = 0; begin < 90; begin += 17) {
    ZnccSums part;
    const int end = std::min(90, begin + 17);
    const ReferenceStrip strip = input.Run(begin, end, &part);
    parts.Add(part);
    for (int y = begin; y < end; ++y) {
      for (int x = 0; x < 611; ++x) {
        ASSERT_EQ(strip.gradient.row(y)[x], whole.gradient.row(y)[x]) << x << " " << y;
        ASSERT_EQ(strip.curvature.row(y)[x], whole.curvature.row(y)[x]) << x << " " << y;
        ASSERT_EQ(strip.count.row(y)[x], whole.count.row(y)[x]) << x << " " << y;
      }
    }
  }
  EXPECT_EQ(parts.windows, sums.windows);
  EXPECT_GT(sums.windows, 10000);
  EXPECT_NEAR(parts.energy, sums.energy, 1e-12 * sums.energy);
  EXPECT_NEAR(parts.semantic_energy, sums.semantic_energy, 1e-12 * sums.semantic_energy);
}

TEST(ZnccKernel, Avx2AndAvx512GiveTheSameBytes) {
  if (!Supports(HWY_AVX3)) GTEST_SKIP() << "this machine has no AVX-512";
  for (int classes : {0, 4, 7}) {
    const RandomPair input = WidePair(classes);
    ZnccSums narrow_sums, wide_sums;
    ReferenceStrip narrow, wide;
    {
      const OnTarget on(HWY_AVX2);
      narrow = input.Run(&narrow_sums);
    }
    {
      const OnTarget on(HWY_AVX3);
      wide = input.Run(&wide_sums);
    }
    for (auto plane : {&ReferenceStrip::inverse_weight, &ReferenceStrip::mean, &ReferenceStrip::variance,
                       &ReferenceStrip::gradient, &ReferenceStrip::curvature, &ReferenceStrip::count}) {
      EXPECT_EQ((narrow.*plane).data, (wide.*plane).data);
    }
    EXPECT_EQ(narrow_sums.energy, wide_sums.energy);
    EXPECT_EQ(narrow_sums.weight, wide_sums.weight);
    EXPECT_EQ(narrow_sums.windows, wide_sums.windows);
    EXPECT_EQ(narrow_sums.semantic_energy, wide_sums.semantic_energy);
    EXPECT_EQ(narrow_sums.semantic_pixels, wide_sums.semantic_pixels);
    EXPECT_GT(narrow_sums.windows, 10000);
  }
}

TEST(ZnccKernel, PlainLoopsDetectAWrongFormula) {
  // The oracle must detect small errors: one tap, one weight or one entry of the warp off by half a per cent.
  const Setting setting;
  const auto used = [](int, int) { return true; };
  const ZnccOracle<double> expected = RandomPair(setting, used).Expected();
  for (int fault = 0; fault < 3; ++fault) {
    RandomPair wrong(setting, used);
    if (fault == 0) wrong.window.taps[2] *= 1.005f;
    if (fault == 1) wrong.window.noise_variance *= 1.05f;
    if (fault == 2) wrong.pair.m[0] *= 1.0005f;
    ZnccSums sums;
    const ReferenceStrip got = wrong.Run(&sums);
    EXPECT_GT(Difference(got.gradient, expected.gradient, setting.width), 3e-3) << fault;
  }
}

}  // namespace
}  // namespace tessera
