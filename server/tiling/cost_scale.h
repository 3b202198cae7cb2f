// Corrects predictions by the usage of earlier jobs of the same city. The cost model's constants were fitted to some
// scenes and machines; the ratio of used to predicted time of a task kind is nearly constant within a city.
#pragma once

#include <map>
#include <string>

#include "server/tiling/cost_model.h"

namespace tessera {

// Summed core-seconds of the executed tasks of a kind.
struct MeasuredCost {
  double predicted = 0;  // by the uncorrected cost model
  double used = 0;
};
using MeasuredCosts = std::map<std::string, MeasuredCost>;  // by kind

// Kinds with a smaller sum are treated as not measured.
inline constexpr double kLeastMeasuredSeconds = 1;
inline constexpr double kLeastScale = 0.125, kMostScale = 8;

// Correction factor per task kind: used / predicted, within the limits. Kinds that were not measured get the ratio of
// all kinds together, or 1 if none was measured. Memory and stored bytes are not corrected, because the tiling depends
// on them.
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
