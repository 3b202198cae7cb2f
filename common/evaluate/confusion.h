// Confusion of labels and the scores that follow from it.
#ifndef TESSERA_COMMON_EVALUATE_CONFUSION_H_
#define TESSERA_COMMON_EVALUATE_CONFUSION_H_

#include <cstdint>
#include <vector>

namespace tessera {

// Counts of (class in the truth, class in the result). A result outside [0, classes) is "nothing": it counts as wrong.
class ConfusionMatrix {
 public:
  explicit ConfusionMatrix(int classes = 0);

  int classes() const { return classes_; }
  // `truth` outside [0, classes) (255, -1) is ignored.
  void Add(int truth, int result, int64_t count = 1);
  void Add(const ConfusionMatrix& other);
  // `result` = classes() is the column of nothing.
  int64_t at(int truth, int result) const { return counts_[truth * (classes_ + 1) + result]; }
  int64_t truth_total(int truth) const;
  int64_t result_total(int result) const;
  int64_t total() const;

 private:
  int classes_;
  std::vector<int64_t> counts_;
};

// NaN where there is nothing to count.
struct ClassLabelScore {
  double recall = 0;     // right of the truth's
  double precision = 0;  // right of the result's
  double iou = 0;        // right of either's
};

struct LabelScores {
  int64_t counted = 0;
  double overall_accuracy = 0;
  double average_accuracy = 0;  // mean recall over classes present in the truth
  double mean_iou = 0;          // over the same classes
  std::vector<ClassLabelScore> classes;
};

LabelScores ScoreLabels(const ConfusionMatrix& confusion);

}  // namespace tessera

#endif  // TESSERA_COMMON_EVALUATE_CONFUSION_H_
