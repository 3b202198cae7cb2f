#include "common/classify/default_rule.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_join.h"
#include "common/classify/features.h"

namespace tessera {
namespace {

constexpr float kGreen = 0.06f, kGreenSlack = 0.02f;  // excess green over the sum of channels
constexpr float kSteep = 0.5f, kSteepSlack = 0.12f;   // cosine between normal and up
constexpr float kHigh_m = 2.2f, kHighSlack_m = 0.6f;  // above the ground
constexpr float kUniformShare = 0.2f;                 // probability mass that is spread over all classes

float Above(float value, float middle, float slack) { return 1 / (1 + std::exp((middle - value) / slack)); }

int FeatureNamed(const std::string& name) {
  const std::vector<std::string>& names = FeatureNames();
  return static_cast<int>(std::find(names.begin(), names.end(), name) - names.begin());
}

}  // namespace

StatusOr<DefaultRule> DefaultRule::Of(const std::vector<std::string>& classes, const std::string& name) {
  DefaultRule rule;
  for (const std::string& c : classes) {
    rule.kinds_.push_back(c == "ground" || c == "terrain"    ? kGround
                          : c == "facade" || c == "wall"     ? kFacade
                          : c == "roof"                      ? kRoof
                          : c == "building"                  ? kBuilding
                          : c == "vegetation" || c == "tree" ? kVegetation
                                                             : kUnknown);
  }
  if (classes.size() - std::count(rule.kinds_.begin(), rule.kinds_.end(), kUnknown) < 2) {
    return InputError(name, "classes", absl::StrJoin(classes, ", "),
                      "at least two of ground, facade, roof, building and vegetation, which the default rule supports; "
                      "for other classes annotate a few images and pass --train DIR");
  }
  rule.greenness_ = FeatureNamed("greenness_2");
  rule.up_normal_ = FeatureNamed("up_normal");
  rule.above_ground_ = FeatureNamed("above_ground_10m");
  return rule;
}

void DefaultRule::Apply(const float* values, int count, int stride, float* out) const {
  const size_t classes = kinds_.size();
  for (int i = 0; i < count; ++i) {
    const auto feature = [&](int f) { return values[static_cast<size_t>(f) * stride + i]; };
    const float green = Above(feature(greenness_), kGreen, kGreenSlack);
    const float steep = 1 - Above(std::abs(feature(up_normal_)), kSteep, kSteepSlack);
    const float high = Above(feature(above_ground_), kHigh_m, kHighSlack_m);
    float* p = out + static_cast<size_t>(i) * classes;
    float sum = 0;
    for (size_t c = 0; c < classes; ++c) {
      const float facade = (1 - green) * steep, roof = (1 - green) * (1 - steep) * high;
      switch (kinds_[c]) {
        case kGround:
          p[c] = (1 - green) * (1 - steep) * (1 - high);
          break;
        case kFacade:
          p[c] = facade;
          break;
        case kRoof:
          p[c] = roof;
          break;
        case kBuilding:
          p[c] = facade + roof;
          break;
        case kVegetation:
          p[c] = green;
          break;
        case kUnknown:
          p[c] = 0;
          break;
      }
      sum += p[c];
    }
    for (size_t c = 0; c < classes; ++c) {
      const float even = 1 / static_cast<float>(classes);
      p[c] = kUniformShare * even + (1 - kUniformShare) * (sum > 1e-6f ? p[c] / sum : even);
    }
  }
}

}  // namespace tessera
