// Evaluations as tables and as JSON.
#pragma once

#include <string>
#include <vector>

#include "common/evaluate/evaluator.h"
#include "common/evaluate/likelihood_scores.h"

namespace tessera {

struct NamedEvaluation {
  std::string name;  // column head, such as "start" or "result"
  Evaluation evaluation;
};

// A table with one column per evaluation and, if there are two, a column of their ratio (second / first). Lengths in
// metres. All evaluations come from one Evaluator, made with `options`. Ends with a newline.
std::string EvaluationTable(const std::vector<NamedEvaluation>& evaluations, const std::vector<std::string>& classes,
                            const EvaluationOptions& options);

// All figures as indented JSON: "options", "classes", and one object per evaluation under "meshes". Figures that could
// not be measured are null. Ends with a newline.
std::string EvaluationJson(const std::vector<NamedEvaluation>& evaluations, const std::vector<std::string>& classes,
                           const EvaluationOptions& options);

// Overall accuracy, average accuracy and mean IoU of each view and of all views; recall, precision and IoU of each
// class over all views; the same for the mesh's labels.
std::string LikelihoodTable(const std::vector<LikelihoodConfusion>& views, const std::vector<std::string>& classes);
std::string LikelihoodJson(const std::vector<LikelihoodConfusion>& views, const std::vector<std::string>& classes);

}  // namespace tessera
