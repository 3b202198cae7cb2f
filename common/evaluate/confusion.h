// Confusion matrix of labels, and the scores computed from it.
#pragma once

#include <cstdint>
#include <vector>

namespace tessera {

// Counts of (class in the truth, class in the result). A result outside [0, classes) means "no label" and counts as
// wrong.
class ConfusionMatrix {
 public:
  explicit ConfusionMatrix(int classes = 0);

  int classes() const { return classes_; }
  // `truth` outside [0, classes) (255, -1) is ignored.
  void Add(int truth, int result, int64_t count = 1);
  void Add(const ConfusionMatrix& other);
  // `result` = classes() is the column for "no label".
  int64_t at(int truth, int result) const { return counts_[truth * (classes_ + 1) + result]; }
  int64_t truth_total(int truth) const;
  int64_t result_total(int result) const;
  int64_t total() const;

 private:
  int classes_;
  std::vector<int64_t> counts_;
};

// NaN for classes without counts.
struct ClassLabelScore {
  double recall = 0;     // correct / pixels of the class in the truth
  double precision = 0;  // correct / pixels of the class in the result
  double iou = 0;        // correct / pixels of the class in either
};

struct LabelScores {
  int64_t counted = 0;
  double overall_accuracy = 0;
  double average_accuracy = 0;  // mean recall over classes present in the truth
  double mean_iou = 0;          // mean over the same classes
  std::vector<ClassLabelScore> classes;
};

LabelScores ScoreLabels(const ConfusionMatrix& confusion);

}  // namespace tessera
