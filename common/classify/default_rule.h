// Likelihoods without any annotation: what geometry and greenness alone tell.
#ifndef TESSERA_COMMON_CLASSIFY_DEFAULT_RULE_H_
#define TESSERA_COMMON_CLASSIFY_DEFAULT_RULE_H_

#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// What is green is vegetation, what is steep is facade, what stands high is roof, the rest ground. A guess: it knows
// nothing of the scene.
class DefaultRule {
 public:
  // Knows classes by name: ground or terrain; facade or wall; roof; building; vegetation or tree. INVALID_ARGUMENT if
  // fewer than two of `classes` are such; `name` stands for the scene in the message.
  static StatusOr<DefaultRule> Of(const std::vector<std::string>& classes, const std::string& name);

  // Probabilities of `count` pixels, feature f of pixel i (FeatureNames) in values[f * stride + i], to
  // out[i * classes + c]. Any thread.
  void Apply(const float* values, int count, int stride, float* out) const;

 private:
  enum Kind { kGround, kFacade, kRoof, kBuilding, kVegetation, kUnknown };
  std::vector<Kind> kinds_;
  int greenness_ = 0, up_normal_ = 0, above_ground_ = 0;  // features
};

}  // namespace tessera

#endif  // TESSERA_COMMON_CLASSIFY_DEFAULT_RULE_H_
