#include "worker/tile/methods.h"

#include "common/job/refine_steps.h"

namespace tessera {
namespace {

// Of the terms where labels take part; the paper gives none of its weights. E_sem believes likelihoods to the pixel,
// and what a classifier gets wrong it presses into the shape; E_inter gains on synthetic cities and loses on helsinki,
// with the truth's labels too: ours goes without both. accuracy_bench --rungs and --sweep show it.
constexpr double kContour = 0.5;
// Tuned on campus and helsinki (README): less for `bend` gives completeness for accuracy, more for `flat` takes both.
// `rough` is what lets pure noise pass for flat; four times less or more is the same within what chance does. Some
// accuracy in crowns, where all bends, for some sharpness of edges that cut across faces.
constexpr CreaseWeights kCreases = {0.12, 1.3, 4};
constexpr double kPaperSemantic = 0.1, kPaperInter = 0.1;
constexpr double kPaperLabelSmoothness = 0.5;  // μ2 of the paper

template <class Value, class Option>
void Override(const std::optional<Value>& value, Option* option) {
  if (value) *option = *value;
}

void Apply(const MethodSettings& settings, TileRefineOptions* options) {
  RefineOptions& geometry = options->geometry;
  Override(settings.semantic, &geometry.semantic);
  Override(settings.thin_plate, &geometry.thin_plate);
  Override(settings.inter, &geometry.inter);
  Override(settings.contour, &geometry.contour);
  Override(settings.normal_prior, &options->label.prior_weight);
  Override(settings.label_smoothness, &options->label.smoothness_weight);
  Override(settings.max_step_px, &geometry.max_step_px);
  Override(settings.window_px, &geometry.window_px);
  Override(settings.partners, &geometry.partners);
  if (!settings.levels.empty()) geometry.levels = settings.levels;
  if (!settings.iterations.empty()) geometry.iterations = settings.iterations;
}

}  // namespace

StatusOr<TileRefineOptions> MethodOptions(const RefineParameters& parameters, const std::vector<SceneClass>& classes,
                                          const LabelTraits& scene) {
  TESSERA_RETURN_IF_ERROR(CheckMethod(parameters.method, parameters.settings));
  TileRefineOptions options;
  const MethodRules rules = MethodRulesOf(parameters.method, parameters.rounds, parameters.settings);
  options.rounds = rules.rounds;
  options.labels_first = LabelStepActs(RefineStep(), rules, scene);
  options.geometry_knows_labels = rules.geometry_knows_labels;
  if (options.geometry_knows_labels) {
    options.geometry.contour = kContour;
    options.geometry.creases = kCreases;
    for (const SceneClass& c : classes) options.geometry.classes.push_back({c.smoothness, c.anchor_weight});
  }
  if (parameters.method == "paper") {
    options.geometry.mixed = 0;
    options.geometry.semantic = kPaperSemantic;
    options.geometry.inter = kPaperInter;
    options.geometry.contour = 0;
    options.geometry.creases = {};
    options.label.form = LabelOptions::Form::kPaper;
    options.label.smoothness_weight = kPaperLabelSmoothness;
  }
  Apply(parameters.settings, &options);
  if (!rules.moves) {
    options.geometry.levels.clear();
    options.geometry.iterations.clear();
  }
  return options;
}

StatusOr<TileRefineOptions> MethodOptions(const RefineParameters& parameters, const TilePackage& package) {
  const LabelTraits traits = {static_cast<int>(package.classes.size()), package.has_likelihoods, package.has_labels};
  TESSERA_ASSIGN_OR_RETURN(TileRefineOptions options, MethodOptions(parameters, package.classes, traits));
  options.geometry.borders = package.borders;
  return options;
}

}  // namespace tessera
