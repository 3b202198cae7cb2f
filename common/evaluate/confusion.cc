#include "common/evaluate/confusion.h"

#include <cstddef>
#include <limits>

namespace tessera {
namespace {

double Ratio(int64_t part, int64_t whole) {
  return whole == 0 ? std::numeric_limits<double>::quiet_NaN() : static_cast<double>(part) / static_cast<double>(whole);
}

}  // namespace

ConfusionMatrix::ConfusionMatrix(int classes)
    : classes_(classes), counts_(static_cast<std::size_t>(classes) * (classes + 1)) {}

void ConfusionMatrix::Add(int truth, int result, int64_t count) {
  if (truth < 0 || truth >= classes_) return;
  if (result < 0 || result >= classes_) result = classes_;
  counts_[truth * (classes_ + 1) + result] += count;
}

void ConfusionMatrix::Add(const ConfusionMatrix& other) {
  for (std::size_t i = 0; i < counts_.size(); ++i) counts_[i] += other.counts_[i];
}

int64_t ConfusionMatrix::truth_total(int truth) const {
  int64_t sum = 0;
  for (int result = 0; result <= classes_; ++result) sum += at(truth, result);
  return sum;
}

int64_t ConfusionMatrix::result_total(int result) const {
  int64_t sum = 0;
  for (int truth = 0; truth < classes_; ++truth) sum += at(truth, result);
  return sum;
}

int64_t ConfusionMatrix::total() const {
  int64_t sum = 0;
  for (int64_t count : counts_) sum += count;
  return sum;
}

LabelScores ScoreLabels(const ConfusionMatrix& confusion) {
  LabelScores scores;
  scores.counted = confusion.total();
  int64_t right = 0, present = 0;
  double recalls = 0, ious = 0;
  for (int c = 0; c < confusion.classes(); ++c) {
    const int64_t hits = confusion.at(c, c), truth = confusion.truth_total(c), result = confusion.result_total(c);
    scores.classes.push_back({Ratio(hits, truth), Ratio(hits, result), Ratio(hits, truth + result - hits)});
    right += hits;
    if (truth == 0) continue;
    ++present;
    recalls += scores.classes.back().recall;
    ious += scores.classes.back().iou;
  }
  scores.overall_accuracy = Ratio(right, scores.counted);
  const double none = std::numeric_limits<double>::quiet_NaN();
  scores.average_accuracy = present ? recalls / static_cast<double>(present) : none;
  scores.mean_iou = present ? ious / static_cast<double>(present) : none;
  return scores;
}

}  // namespace tessera
