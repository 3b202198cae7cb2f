#include "tests/bench/accuracy/accuracy_table.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>

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

// What is compared between two rows of a table; NaN if either lacks it.
using Figure = std::function<double(const AccuracyRow&)>;

double MeanDistance(const AccuracyRow& row) { return row.evaluation.surface.accuracy.mean_m; }

Figure MeanDistanceOf(const AccuracyTable& table, const std::string& class_name) {
  const auto at = std::find(table.classes.begin(), table.classes.end(), class_name) - table.classes.begin();
  return [at](const AccuracyRow& row) {
    const auto& by_class = row.evaluation.surface_by_class;
    return at < static_cast<ptrdiff_t>(by_class.size()) ? by_class[at].accuracy.mean_m : std::nan("");
  };
}

double LabelScore(const AccuracyRow& row, double LabelScores::*score) {
  const auto& labels = row.evaluation.labels_by_pixels;
  return labels ? labels->scores.*score : std::nan("");
}

// Mean of `compare` over the synthetic scenes that have both rows; NaN if none.
template <class Compare>
double MeanOver(const std::vector<AccuracyTable>& tables, const std::string& row, const std::string& other, int* scenes,
                const Compare& compare) {
  double sum = 0;
  *scenes = 0;
  for (const AccuracyTable& table : tables) {
    const AccuracyRow* a = FindRow(table, row);
    const AccuracyRow* b = FindRow(table, other);
    if (!table.synthetic || a == nullptr || b == nullptr) continue;
    sum += compare(table, *a, *b);
    ++*scenes;
  }
  return *scenes > 0 ? sum / *scenes : std::nan("");
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
  std::printf(
      "\nsynthetic scenes: geometric mean of the ratios of mean distances to the truth, points of labels gained\n");
  std::printf("%-44s|%8s|%10s%8s%8s|%8s%8s|%7s\n", "", "/ start", "/ baseline", "facade", "roof", "OA", "AA", "scenes");
  for (const std::string& name : names) {
    int scenes = 0, with_baseline = 0;
    const auto ratio = [&](const std::string& over, int* count, const std::string& class_name) {
      return std::exp(MeanOver(tables, name, over, count, [&](const auto& table, const auto& a, const auto& b) {
        const Figure figure = class_name.empty() ? Figure(MeanDistance) : MeanDistanceOf(table, class_name);
        return std::log(figure(a) / figure(b));
      }));
    };
    const auto gain = [&](double LabelScores::*score) {
      return 100 * MeanOver(tables, name, "start", &scenes, [&](const auto&, const auto& a, const auto& b) {
               return LabelScore(a, score) - LabelScore(b, score);
             });
    };
    std::printf("%-44.44s|", name.c_str());
    PrintNumber(ratio("start", &scenes, ""), 3);
    std::printf("|  ");
    PrintNumber(ratio("baseline", &with_baseline, ""), 3);
    PrintNumber(ratio("baseline", &with_baseline, "facade"), 3);
    PrintNumber(ratio("baseline", &with_baseline, "roof"), 3);
    std::printf("|");
    PrintNumber(gain(&LabelScores::overall_accuracy), 2);
    PrintNumber(gain(&LabelScores::average_accuracy), 2);
    std::printf("|%7d\n", scenes);
  }
  std::fflush(stdout);
}

}  // namespace tessera
