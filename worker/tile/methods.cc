#include "worker/tile/methods.h"

#include "common/tile/refine_steps.h"

namespace tessera {
namespace {

// Of the terms where labels take part: what did best on synthetic cities (accuracy_bench --methods tessera --sweep
// semantic=...); the paper gives none of its weights.
constexpr double kSemantic = 0.1, kInter = 0.1, kContour = 0.5;
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
    options.geometry.semantic = kSemantic;
    options.geometry.inter = kInter;
    options.geometry.contour = kContour;
    for (const SceneClass& c : classes) options.geometry.classes.push_back({c.smoothness, 0});
  }
  if (parameters.method == "paper") {
    options.geometry.mixed = 0;
    options.geometry.contour = 0;
    options.label.form = LabelOptions::Form::kPaper;
    options.label.smoothness_weight = kPaperLabelSmoothness;
  }
  Apply(parameters.settings, &options);
  return options;
}

}  // namespace tessera
