#include "worker/tasks/methods.h"

namespace tessera {
namespace {

// Of the paper's terms where labels take part; it gives none of its weights.
constexpr double kPaperSemantic = 0.2, kPaperInter = 0.02;
constexpr int kPaperRounds = 5;

template <class Value, class Option>
void Override(const std::optional<Value>& value, Option* option) {
  if (value) *option = *value;
}

void Apply(const MethodSettings& settings, TileRefineOptions* options) {
  RefineOptions& geometry = options->geometry;
  Override(settings.semantic, &geometry.semantic);
  Override(settings.thin_plate, &geometry.thin_plate);
  Override(settings.inter, &geometry.inter);
  Override(settings.max_step_px, &geometry.max_step_px);
  Override(settings.window_px, &geometry.window_px);
  Override(settings.partners, &geometry.partners);
  Override(settings.labels_first, &options->labels_first);
  if (!settings.levels.empty()) geometry.levels = settings.levels;
  if (!settings.iterations.empty()) geometry.iterations = settings.iterations;
}

}  // namespace

StatusOr<TileRefineOptions> MethodOptions(const RefineParameters& parameters, const std::vector<SceneClass>& classes) {
  TESSERA_RETURN_IF_ERROR(CheckMethod(parameters.method, parameters.settings));
  TileRefineOptions options;
  const bool baseline = parameters.method == "baseline";
  if (baseline) {
    options.rounds = 1;
    options.geometry.semantic = options.geometry.inter = options.geometry.mixed = 0;
  } else if (parameters.method == "paper") {
    options.rounds = kPaperRounds;
    options.geometry.semantic = kPaperSemantic;
    options.geometry.inter = kPaperInter;
    options.geometry.mixed = 0;
    options.label.form = LabelOptions::Form::kPaper;
  }
  options.geometry_knows_labels = !baseline;
  if (!baseline) {
    for (const SceneClass& c : classes) options.geometry.classes.push_back({c.smoothness, 0});
  }
  if (parameters.rounds > 0) options.rounds = parameters.rounds;
  Apply(parameters.settings, &options);
  return options;
}

}  // namespace tessera
