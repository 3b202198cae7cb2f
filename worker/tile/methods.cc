#include "worker/tile/methods.h"

#include "common/job/refine_steps.h"

namespace tessera {
namespace {

// Weight of E_contour; the paper gives no weights. We use neither E_sem, which moves the surface where the classifier
// is wrong, nor E_inter, which improves synthetic cities but worsens helsinki even with true labels (accuracy_bench
// --rungs,
// --sweep).
constexpr double kContour = 0.5;
// Tuned on campus and helsinki (worker/README.md). A smaller `bend` improves completeness and worsens accuracy; a
// larger `flat` worsens both; a factor of 4 in `rough` makes no significant difference. The cost is some accuracy in
// tree crowns.
constexpr CreaseWeights kCreases = {0.12, 1.3, 4};

template <class Value, class Option>
void Override(const std::optional<Value>& value, Option* option) {
  if (value) *option = *value;
}

void Apply(const MethodSettings& settings, TileRefineOptions* options) {
  Override(settings.semantic, &options->data.semantic);
  Override(settings.thin_plate, &options->step.thin_plate);
  Override(settings.inter, &options->step.inter);
  Override(settings.contour, &options->data.contour);
  Override(settings.normal_prior, &options->label.prior_weight);
  Override(settings.label_smoothness, &options->label.smoothness_weight);
  Override(settings.max_step_px, &options->step.max_step_px);
  Override(settings.window_px, &options->data.window_px);
}

// ActiveSteps of the job.
std::vector<int> ActiveOf(const RefineParameters& parameters, const TilePackage& package) {
  return ActiveSteps(RefineStepsOf(parameters.method, parameters.rounds, parameters.settings),
                     MethodRulesOf(parameters.method, parameters.rounds, parameters.settings),
                     {static_cast<int>(package.classes.size()), package.has_likelihoods, package.has_labels});
}

}  // namespace

StatusOr<TileRefineOptions> MethodOptions(const RefineParameters& parameters, const std::vector<SceneClass>& classes) {
  TESSERA_RETURN_IF_ERROR(CheckMethod(parameters.method, parameters.settings));
  TileRefineOptions options;
  options.geometry_uses_labels =
      MethodRulesOf(parameters.method, parameters.rounds, parameters.settings).geometry_uses_labels;
  if (options.geometry_uses_labels) {
    options.data.contour = kContour;
    options.step.creases = kCreases;
    for (const SceneClass& c : classes) options.step.classes.push_back({c.smoothness, c.anchor_weight});
  }
  if (parameters.method == "paper") {
    options.step.mixed = 0;
    options.data.semantic = kPaperSemantic;
    options.step.inter = kPaperInter;
    options.data.contour = 0;
    options.step.creases = {};
    options.label.form = LabelOptions::Form::kPaper;
    options.label.smoothness_weight = kPaperLabelSmoothness;
  }
  Apply(parameters.settings, &options);
  return options;
}

StatusOr<TileRefineOptions> MethodOptions(const RefineParameters& parameters, const TilePackage& package) {
  TESSERA_ASSIGN_OR_RETURN(TileRefineOptions options, MethodOptions(parameters, package.classes));
  options.data.borders = package.borders;
  return options;
}

std::vector<TileStep> TileStepsOf(const std::vector<RefineStep>& steps) {
  int finest = -1;
  for (const RefineStep& step : steps) {
    if (!step.labels()) finest = step.level;
  }
  std::vector<TileStep> out;
  for (const RefineStep& step : steps) {
    TileStep at = {step, 0, !step.labels() && step.level == finest};
    if (!out.empty() && out.back().step.level == step.level && out.back().step.round == step.round) {
      at.level_iteration = out.back().level_iteration + 1;
    }
    out.push_back(at);
  }
  return out;
}

std::vector<TileStep> ActiveTileSteps(const RefineParameters& parameters, const TilePackage& package) {
  const std::vector<RefineStep> steps = RefineStepsOf(parameters.method, parameters.rounds, parameters.settings);
  const int first_fine =
      FirstFineStep(steps, MethodRulesOf(parameters.method, parameters.rounds, parameters.settings));
  const std::vector<TileStep> all = TileStepsOf(steps);
  std::vector<TileStep> active;
  for (const int s : ActiveOf(parameters, package)) {
    if (IsStepOf(parameters.part, s, first_fine)) active.push_back(all[s]);
  }
  return active;
}

bool IsLastOfMoves(const RefineParameters& parameters, const TilePackage& package, int step) {
  const std::vector<int> active = ActiveOf(parameters, package);
  return package.has_pairs && MethodRulesOf(parameters.method, parameters.rounds, parameters.settings).moves &&
         !active.empty() && active.back() == step;
}

}  // namespace tessera
