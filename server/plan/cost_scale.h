// What earlier jobs of the same city took, against what the cost model alone predicts for them. The model's constants
// are those of some scenes and machines; how far a kind of task lies from them is much the same in all jobs of a city.
#ifndef TESSERA_SERVER_PLAN_COST_SCALE_H_
#define TESSERA_SERVER_PLAN_COST_SCALE_H_

#include <map>
#include <string>

#include "server/plan/cost_model.h"

namespace tessera {

// Core-seconds of all tasks of a kind that ran, summed.
struct MeasuredCost {
  double predicted = 0;  // by the cost model alone
  double used = 0;
};
using MeasuredCosts = std::map<std::string, MeasuredCost>;  // by kind

// A kind that took less than this in sum was not measured.
inline constexpr double kLeastMeasuredSeconds = 1;
inline constexpr double kLeastScale = 0.125, kMostScale = 8;

// Factors by which predictions for tasks of a kind are corrected: used / predicted, within the limits; of kinds that
// were not measured the ratio of all kinds together, and 1 where nothing was. Memory stays as predicted: the tiling
// rests on it; so does what is stored.
class CostScale {
 public:
  CostScale() = default;
  explicit CostScale(const MeasuredCosts& measured);

  double Of(const std::string& kind) const;
  Prediction Corrected(const std::string& kind, const Prediction& prediction) const {
    return {prediction.core_seconds * Of(kind), prediction.peak_bytes, prediction.stored_bytes};
  }

 private:
  std::map<std::string, double> of_kind_;
  double of_others_ = 1;
};

}  // namespace tessera

#endif  // TESSERA_SERVER_PLAN_COST_SCALE_H_
