#include "server/tiling/cost_scale.h"

#include <algorithm>

namespace tessera {
namespace {

bool IsMeasured(const MeasuredCost& cost) { return cost.predicted > 0 && cost.used >= kLeastMeasuredSeconds; }

double Ratio(const MeasuredCost& cost) { return std::clamp(cost.used / cost.predicted, kLeastScale, kMostScale); }

}  // namespace

CostScale::CostScale(const MeasuredCosts& measured) {
  MeasuredCost all;
  for (const auto& [kind, cost] : measured) {
    all.predicted += cost.predicted;
    all.used += cost.used;
    if (IsMeasured(cost)) of_kind_[kind] = Ratio(cost);
  }
  if (IsMeasured(all)) of_others_ = Ratio(all);
}

double CostScale::Of(const std::string& kind) const {
  const auto it = of_kind_.find(kind);
  return it == of_kind_.end() ? of_others_ : it->second;
}

}  // namespace tessera
