// An evaluation as people read it and as programs do.
#ifndef TESSERA_COMMON_EVALUATE_REPORT_H_
#define TESSERA_COMMON_EVALUATE_REPORT_H_

#include <string>
#include <vector>

#include "common/evaluate/evaluator.h"

namespace tessera {

struct NamedEvaluation {
  std::string name;  // head of its column: "start", "result"
  Evaluation evaluation;
};

// A table with a column an evaluation and, if there are two, the second's figures over the first's. Lengths in metres.
// All evaluations come from one Evaluator, made with `options`. Ends with a newline.
std::string EvaluationTable(const std::vector<NamedEvaluation>& evaluations, const std::vector<std::string>& classes,
                            const EvaluationOptions& options);

// The same and everything else as JSON, indented: "options", "classes", and under "meshes" an object an evaluation.
// What could not be measured is null. Ends with a newline.
std::string EvaluationJson(const std::vector<NamedEvaluation>& evaluations, const std::vector<std::string>& classes,
                           const EvaluationOptions& options);

// A view's likeliest classes against its truth, and a mesh's labels over the same pixels (empty: no mesh).
struct NamedConfusion {
  std::string name;
  ConfusionMatrix confusion;
  ConfusionMatrix mesh;
};

// Overall and average accuracy and mean IoU of each view and of all together, and recall and precision a class of all;
// then those of the mesh's labels.
std::string LikelihoodTable(const std::vector<NamedConfusion>& views, const std::vector<std::string>& classes);
std::string LikelihoodJson(const std::vector<NamedConfusion>& views, const std::vector<std::string>& classes);

}  // namespace tessera

#endif  // TESSERA_COMMON_EVALUATE_REPORT_H_
