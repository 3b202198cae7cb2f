// What the accuracy bench prints.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/evaluate/evaluator.h"
#include "tests/bench/accuracy/surface_folds.h"

namespace tessera {

struct AccuracyRow {
  std::string name;  // "start", "peer", a variant
  Evaluation evaluation;
  std::optional<SurfaceFolds> folds;
  std::optional<double> cpu_s;  // of the whole job
};

struct AccuracyTable {
  std::string scene;
  bool synthetic = false;
  double gsd_m = 0;
  std::vector<std::string> classes;
  EvaluationOptions options;
  std::vector<AccuracyRow> rows;
};

void Print(const AccuracyTable& table);

// The geometric means over the synthetic scenes of the ratio of each variant's mean distance to the truth over the
// start's and over the baseline's (where there is such a row).
void PrintRatios(const std::vector<AccuracyTable>& tables);

}  // namespace tessera
