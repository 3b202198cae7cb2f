// Likelihoods without training, from geometry and greenness.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// A fixed rule: green pixels are vegetation, steep surfaces facade, elevated surfaces roof, all others ground. It is
// not adapted to the scene.
class DefaultRule {
 public:
  // Supported class names: ground, terrain; facade, wall; roof; building; vegetation, tree. INVALID_ARGUMENT if fewer
  // than two of `classes` are supported; `name` is the scene's name in the message.
  static StatusOr<DefaultRule> Of(const std::vector<std::string>& classes, const std::string& name);

  // Writes the probabilities of `count` pixels to out[i * classes + c]; feature f (see FeatureNames) of pixel i is
  // values[f * stride + i]. Thread-safe.
  void Apply(const float* values, int count, int stride, float* out) const;

 private:
  enum Kind { kGround, kFacade, kRoof, kBuilding, kVegetation, kUnknown };
  std::vector<Kind> kinds_;
  int greenness_ = 0, up_normal_ = 0, above_ground_ = 0;  // feature indices
};

}  // namespace tessera
