#include "tests/bench/accuracy_table.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace tessera {
namespace {

void PrintNumber(std::optional<double> value, int decimals) {
  if (value && std::isfinite(*value)) {
    std::printf(" %7.*f", decimals, *value);
  } else {
    std::printf(" %7s", "-");
  }
}

const AccuracyRow* FindRow(const AccuracyTable& table, const std::string& name) {
  const auto row =
      std::find_if(table.rows.begin(), table.rows.end(), [&](const AccuracyRow& r) { return r.name == name; });
  return row == table.rows.end() ? nullptr : &*row;
}

double MeanDistance(const AccuracyRow& row) { return row.evaluation.surface.accuracy.mean_m; }

// NaN if no scene has both rows.
double GeometricMeanRatio(const std::vector<AccuracyTable>& tables, const std::string& row, const std::string& over,
                          int* scenes) {
  double sum = 0;
  *scenes = 0;
  for (const AccuracyTable& table : tables) {
    const AccuracyRow* a = FindRow(table, row);
    const AccuracyRow* b = FindRow(table, over);
    if (!table.synthetic || a == nullptr || b == nullptr) continue;
    sum += std::log(MeanDistance(*a) / MeanDistance(*b));
    ++*scenes;
  }
  return *scenes > 0 ? std::exp(sum / *scenes) : std::nan("");
}

}  // namespace

void Print(const AccuracyTable& table) {
  std::printf("\n%s: GSD %.3f m; metres, capped at %.2f; F at", table.scene.c_str(), table.gsd_m, table.options.cap_m);
  for (const double distance_m : table.options.f_distances_m) std::printf(" %.3f", distance_m);
  std::printf("\n%-44s|%24s|%8s|%*s|%*s|%24s|%16s|\n", "", "accuracy", "compl.",
              static_cast<int>(8 * table.options.f_distances_m.size()), "F", static_cast<int>(8 * table.classes.size()),
              "accuracy capped, a class", "labels by pixels", "folds");
  std::printf("%-44s|%8s%8s%8s|%8s|", "", "mean", "capped", "median", "capped");
  for (size_t k = 0; k < table.options.f_distances_m.size(); ++k) std::printf("%7s%zu", "F", k + 1);
  std::printf("|");
  for (const std::string& name : table.classes) std::printf(" %7.7s", name.c_str());
  std::printf("|%8s%8s%8s|%8s%8s|%8s\n", "OA", "AA", "mIoU", "turned", "cross", "CPU s");
  for (const AccuracyRow& row : table.rows) {
    const SurfaceScores& surface = row.evaluation.surface;
    std::printf("%-44.44s|", row.name.c_str());
    PrintNumber(surface.accuracy.mean_m, 4);
    PrintNumber(surface.accuracy.capped_mean_m, 4);
    PrintNumber(surface.accuracy.median_m, 4);
    std::printf("|");
    PrintNumber(surface.completeness.capped_mean_m, 4);
    std::printf("|");
    for (const FScore& score : surface.f_scores) PrintNumber(score.f, 3);
    std::printf("|");
    for (size_t c = 0; c < table.classes.size(); ++c) {
      const auto& by_class = row.evaluation.surface_by_class;
      PrintNumber(c < by_class.size() ? std::optional(by_class[c].accuracy.capped_mean_m) : std::nullopt, 4);
    }
    std::printf("|");
    const auto& labels = row.evaluation.labels_by_pixels;
    PrintNumber(labels ? std::optional(labels->scores.overall_accuracy) : std::nullopt, 3);
    PrintNumber(labels ? std::optional(labels->scores.average_accuracy) : std::nullopt, 3);
    PrintNumber(labels ? std::optional(labels->scores.mean_iou) : std::nullopt, 3);
    std::printf("|");
    PrintNumber(row.folds ? std::optional<double>(row.folds->turned_faces) : std::nullopt, 0);
    PrintNumber(row.folds ? std::optional<double>(row.folds->crossing_pairs) : std::nullopt, 0);
    std::printf("|");
    PrintNumber(row.cpu_s, 1);
    std::printf("\n");
  }
  std::fflush(stdout);
}

void PrintRatios(const std::vector<AccuracyTable>& tables) {
  std::vector<std::string> names;
  for (const AccuracyTable& table : tables) {
    for (const AccuracyRow& row : table.rows) {
      if (!table.synthetic || !row.cpu_s || std::find(names.begin(), names.end(), row.name) != names.end()) continue;
      names.push_back(row.name);
    }
  }
  if (names.empty()) return;
  std::printf("\nsynthetic scenes: geometric mean of the ratios of mean distances to the truth\n");
  std::printf("%-44s|%8s|%10s|%7s\n", "", "/ start", "/ baseline", "scenes");
  for (const std::string& name : names) {
    int scenes = 0, with_baseline = 0;
    std::printf("%-44.44s|", name.c_str());
    PrintNumber(GeometricMeanRatio(tables, name, "start", &scenes), 3);
    std::printf("|  ");
    PrintNumber(GeometricMeanRatio(tables, name, "baseline", &with_baseline), 3);
    std::printf("|%7d\n", scenes);
  }
  std::fflush(stdout);
}

}  // namespace tessera
