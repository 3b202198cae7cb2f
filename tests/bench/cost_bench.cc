// cost_bench RUN...: holds the predictions of server/tiling/cost_model.cc against what workers reported. Each RUN is a
// folder with the job.json of a finished job and the survey.json that its ingest made (`tessera plan SCENE --survey
// FILE` writes it). Prints, as a table, the quantities of each task with what was measured and predicted, for fitting,
// and the spread of measured / predicted a kind of task.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "common/job/task_parameters.h"
#include "common/storage/files.h"
#include "server/plan/graph.h"
#include "server/tiling/cost_model.h"
#include "server/tiling/crop_groups.h"

namespace tessera {
namespace {

using nlohmann::json;

JobSettings SettingsOf(const json& job) {
  JobSettings settings;
  settings.tiles = job.at("settings").at("tiles");
  settings.rounds = job.at("settings").at("rounds");
  settings.method = job.at("settings").at("method");
  const auto method = ParseMethodSettings(job.at("settings").at("method_settings").dump());
  if (method.ok()) settings.method_settings = *method;
  return settings;
}

// Of each kind of task: measured / predicted.
struct Spread {
  std::vector<double> seconds, bytes, stored;
};

double Quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[static_cast<size_t>(std::lround(q * static_cast<double>(values.size() - 1)))];
}

Status Show(const std::string& run, std::map<std::string, Spread>* spreads) {
  TESSERA_ASSIGN_OR_RETURN(const std::string job_text, ReadFile(run + "/job.json"));
  TESSERA_ASSIGN_OR_RETURN(const std::string survey_text, ReadFile(run + "/survey.json"));
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(survey_text));
  const json job = json::parse(job_text);
  const JobSettings settings = SettingsOf(job);
  const std::vector<RefineStep> steps = RefineStepsOf(settings.method, settings.rounds, settings.method_settings);
  const CellIndex cells(survey);
  std::map<int, CellRect> cores;
  for (const json& task : job.at("tasks")) {
    if (task.at("kind") != "cut") continue;
    TESSERA_ASSIGN_OR_RETURN(const CutParameters parameters, ParseCutParameters(task.at("parameters").dump()));
    cores[parameters.tile.tile] = parameters.tile.core;
  }
  double stored_in_all = 0, predicted_in_all = 0;
  // The survey that the tasks were planned from: after the second split with its number of faces.
  Survey now = survey;
  double split_again = 1;
  bool is_fine = false;
  const int first_fine = FirstFineStepOf(settings);
  for (const json& task : job.at("tasks")) {
    if (!task.contains("used")) continue;
    const std::string kind = task.at("kind"), title = task.at("title");
    const double seconds = task.at("used").at("core_seconds"), bytes = task.at("used").at("peak_bytes");
    const int threads = task.at("used").at("threads");
    Prediction prediction;
    TileWork work;
    const int tile = task.at("tile");
    if (tile >= 0) work = WithFaces(MeasureTile(cells, cores[tile]), split_again);
    if (is_fine) work = InFinePart(std::move(work));
    RefineEffort effort;
    if (kind == "refine") {
      TESSERA_ASSIGN_OR_RETURN(const RefineParameters refine, ParseRefineParameters(task.at("parameters").dump()));
      std::vector<int> of_part = ActiveStepsOf(settings, survey);
      std::erase_if(of_part, [&](int s) { return !IsStepOf(refine.part, s, first_fine); });
      effort = EffortOf(steps, of_part);
      if (refine.part != JobPart::kFine) effort.mends += 1;  // of the start
      prediction = PredictRefine(work, effort);
    }
    if (kind == "split") {
      const double coarse = task.at("stats").at("coarse_faces"), fine = task.at("stats").at("faces");
      prediction = PredictSplit(coarse, fine);
      split_again = fine / coarse;
      is_fine = true;
      now.faces = std::llround(fine);
    }
    if (kind == "measure" || kind == "solve") {
      TESSERA_ASSIGN_OR_RETURN(const StepParameters step, ParseStepParameters(task.at("parameters").dump()));
      effort = EffortOf(steps.at(step.step));
      prediction = kind == "measure" ? PredictMeasure(work, effort) : PredictSolve(work, effort);
    }
    if (kind == "mend") {
      effort.mends = 1;
      prediction = PredictMend(work, effort);
    }
    if (kind == "crop") {
      TESSERA_ASSIGN_OR_RETURN(const CropParameters crop, ParseCropParameters(task.at("parameters").dump()));
      std::map<int, TileWork> works;
      std::vector<CroppedTile> tiles;
      for (const int each : crop.tiles) works[each] = WithFaces(MeasureTile(cells, cores[each]), split_again);
      for (const int each : crop.tiles) tiles.push_back({each, &works[each]});
      work = CropGroupsOf(survey, tiles, std::numeric_limits<int64_t>::max()).front().work;
      prediction = is_fine ? PredictFineCrop(work) : PredictCrop(work);
    }
    if (kind == "cut") prediction = PredictCut(now, work);
    if (kind == "ingest") prediction = PredictIngest(survey);
    if (kind == "publish") prediction = PredictPublish(now);
    std::printf(
        "%s\t%s\t%d\t%.0f\t%.0f\t%.0f\t%.0f\t%d\t%.0f\t%.0f\t%.0f\t%.0f\t%.0f\t%.0f\t%d\t%.3f\t%.0f\t%.0f\t%zu\t%d\t%."
        "3f\t%."
        "1f\t%."
        "3f\t%.1f\t%.0f\n",
        run.c_str(), kind.c_str(), tile, static_cast<double>(survey.faces), work.core_faces, work.solve_faces,
        work.package_faces, work.seeing_views, work.pixels, work.pair_pixels, work.drawn_faces, work.open_pixels,
        work.image_pixels, work.largest_crop, work.likelihood_planes, effort.evaluations, effort.iterations,
        effort.labellings, survey.views.size(), threads, seconds, bytes / (1 << 20), prediction.core_seconds,
        static_cast<double>(prediction.peak_bytes) / (1 << 20),
        task.at("stats").is_object() ? task.at("stats").value("faces", 0.0) : 0.0);
    Spread& spread = (*spreads)[kind];
    if (prediction.core_seconds > 0) spread.seconds.push_back(seconds / prediction.core_seconds);
    double stored = 0;
    for (const auto& [name, file] : task.at("outputs").items()) stored += file.at("size_bytes").get<double>();
    if (prediction.stored_bytes > 0) {
      spread.stored.push_back(stored / static_cast<double>(prediction.stored_bytes));
      stored_in_all += stored;
      predicted_in_all += static_cast<double>(prediction.stored_bytes);
    }
    if (bytes > 0) spread.bytes.push_back(bytes / static_cast<double>(prediction.peak_bytes));
  }
  if (predicted_in_all > 0) (*spreads)["(run)"].stored.push_back(stored_in_all / predicted_in_all);
  return absl::OkStatus();
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) {
  std::vector<std::string> runs;
  CLI::App app("Predictions of cost, memory and disk against what workers reported");
  app.add_option("RUN", runs, "Folders with job.json and survey.json")->required();
  CLI11_PARSE(app, argc, argv);
  std::printf(
      "run\tkind\ttile\tcity_faces\tcore_faces\tsolve_faces\tpackage_faces\tviews\tpixels\tpair_pixels\tdrawn_"
      "faces\topen_pixels\t"
      "image_pixels\tlargest_crop\tplanes\tevaluations\titerations\tlabellings\tcity_"
      "views\tthreads\tseconds\tMiB\tpredicted_"
      "s\tpredicted_MiB\treported_faces\n");
  std::map<std::string, tessera::Spread> spreads;
  for (const std::string& run : runs) {
    const tessera::Status status = tessera::Show(run, &spreads);
    if (!status.ok()) {
      std::fprintf(stderr, "cost_bench: %s\n", std::string(status.message()).c_str());
      return 1;
    }
  }
  std::fprintf(stderr, "measured / predicted       tasks    5 %%  median   95 %%   least    most\n");
  for (const auto& [kind, spread] : spreads) {
    const auto line = [&](const char* what, const std::vector<double>& ratios) {
      std::fprintf(stderr, "%-8s %-14s %8zu  %6.2f  %6.2f  %6.2f  %6.2f  %6.2f\n", kind.c_str(), what, ratios.size(),
                   tessera::Quantile(ratios, 0.05), tessera::Quantile(ratios, 0.5), tessera::Quantile(ratios, 0.95),
                   tessera::Quantile(ratios, 0), tessera::Quantile(ratios, 1));
    };
    line("core-seconds", spread.seconds);
    line("peak memory", spread.bytes);
    line("stored", spread.stored);
  }
  return 0;
}
