// How near the methods come to the truth, in one process:
//   accuracy_bench --seeds 1,2,3,4,5 --scene campus --methods baseline,paper,tessera --out DIR
// prints a table a scene (start, the peer's mesh if the scene has a peer_refined.ply, the methods) and, over the
// synthetic cities of the seeds, the ratios. More questions: --drift (where a run that starts from the truth ends),
// --sweep thin_plate=0.1,0.3,1 (a row for each value), --leave-out K (scenes without truth).
#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/imaging/image_io.h"
#include "common/job/task_parameters.h"
#include "common/storage/files.h"
#include "tests/bench/accuracy/accuracy_table.h"
#include "tests/bench/accuracy/bench_scenes.h"
#include "tests/bench/accuracy/left_out_view.h"
#include "tests/bench/accuracy/likelihood_ladder.h"
#include "tests/bench/accuracy/scene_runner.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

constexpr double kRimGsd = 30;  // as `tessera evaluate` has it

struct Arguments {
  std::vector<uint64_t> seeds;
  std::vector<std::string> scenes, methods = {"baseline", "paper", "tessera"}, rungs;
  std::string blocks = "1x1", out, settings = "{}", sweep;
  SynthOptions synth;
  int rounds = 0, tiles = 1, threads = 0, leave_out = -1;
  bool drift = false, no_folds = false, ablation = false;
};

// A job that gets a row.
struct Variant {
  std::string name;
  JobSettings settings;
};

// Our method with each of its terms left out.
StatusOr<std::vector<Variant>> MakeAblation(const Arguments& arguments) {
  std::vector<Variant> variants;
  const auto add = [&](const std::string& name, const nlohmann::json& change) -> Status {
    nlohmann::json merged = nlohmann::json::parse(arguments.settings, nullptr, false);
    merged.update(change);
    TESSERA_ASSIGN_OR_RETURN(const MethodSettings settings, ParseMethodSettings(merged.dump()));
    variants.push_back({name, {arguments.tiles, 0, arguments.rounds, kMethods[0], settings}});
    return CheckJobSettings(variants.back().settings);
  };
  TESSERA_RETURN_IF_ERROR(add(kMethods[0], nlohmann::json::object()));
  for (const char* term : {"thin_plate", "contour", "normal_prior", "label_smoothness"}) {
    TESSERA_RETURN_IF_ERROR(add(absl::StrCat("without ", term), {{term, 0}}));
  }
  TESSERA_RETURN_IF_ERROR(add("without labels first", {{"labels_first", false}}));
  return variants;
}

// "name=a,b,c" laid over the settings that all rows share, for each method; all must take them.
StatusOr<std::vector<Variant>> MakeVariants(const Arguments& arguments) {
  TESSERA_ASSIGN_OR_RETURN(const MethodSettings shared, ParseMethodSettings(arguments.settings));
  std::vector<std::pair<std::string, MethodSettings>> settings = {{"", shared}};
  if (!arguments.sweep.empty()) {
    settings.clear();
    const size_t equal = arguments.sweep.find('=');
    if (equal == std::string::npos) return absl::InvalidArgumentError("--sweep: expected NAME=VALUE,VALUE,...");
    const std::string name = arguments.sweep.substr(0, equal);
    for (const std::string& value : CLI::detail::split(arguments.sweep.substr(equal + 1), ',')) {
      const nlohmann::json number = nlohmann::json::parse(value, nullptr, false);
      nlohmann::json merged = nlohmann::json::parse(ToJson(shared));
      merged[name] = number;
      TESSERA_ASSIGN_OR_RETURN(const MethodSettings one, ParseMethodSettings(merged.dump()));
      settings.push_back({absl::StrCat(" ", name, "=", value), one});
    }
  }
  std::vector<Variant> variants;
  for (const std::string& method : arguments.methods) {
    if (method == "baseline" && !arguments.rungs.empty()) {  // what the rungs stand beside
      variants.push_back({method, {arguments.tiles, 0, arguments.rounds, method, {}}});
      continue;
    }
    for (const auto& [suffix, one] : settings) {
      Variant variant = {method + suffix, {arguments.tiles, 0, arguments.rounds, method, one}};
      TESSERA_RETURN_IF_ERROR(CheckJobSettings(variant.settings));
      variants.push_back(std::move(variant));
    }
  }
  return variants;
}

StatusOr<AccuracyTable> BenchScene(const std::string& folder, bool synthetic, const std::vector<Variant>& variants,
                                   const Arguments& arguments) {
  Warnings warnings;
  TESSERA_ASSIGN_OR_RETURN(const SceneDescription scene, LoadScene(folder, &warnings));
  TESSERA_ASSIGN_OR_RETURN(TriangleMesh truth, ReadLocalMesh(scene.folder + "/truth/mesh.ply", scene.frame));
  AccuracyTable table;
  table.scene = fs::path(scene.folder).filename().string();
  table.synthetic = synthetic;
  for (const SceneClass& c : scene.classes) table.classes.push_back(c.name);
  TESSERA_ASSIGN_OR_RETURN(table.gsd_m, MedianGsd(scene, truth));
  table.options.up_in_local = scene.up_in_local;
  table.options.rim_m = 0.01 * std::round(100 * kRimGsd * table.gsd_m);
  table.options.f_distances_m = {0.05, 0.10};
  if (synthetic) table.options.f_distances_m = {0.5 * table.gsd_m, table.gsd_m};
  const TruthLabelSource truth_labels = [&scene](size_t view) -> StatusOr<LabelImage> {
    const fs::path name(scene.views[view].name);
    const fs::path path = fs::path(scene.folder) / "truth" / name.parent_path() / (name.stem().string() + "_label.png");
    if (!fs::exists(path)) return LabelImage();
    return ReadLabelImage(path.string());
  };
  TESSERA_ASSIGN_OR_RETURN(const Evaluator evaluator,
                           Evaluator::Create(std::move(truth), scene.views, static_cast<int>(scene.classes.size()),
                                             truth_labels, table.options));
  const auto add = [&](const std::string& name, const TriangleMesh& mesh) -> Status {
    TESSERA_ASSIGN_OR_RETURN(Evaluation evaluation, evaluator.Evaluate(mesh));
    table.rows.push_back({name, std::move(evaluation), std::nullopt, std::nullopt});
    return absl::OkStatus();
  };
  TESSERA_ASSIGN_OR_RETURN(const TriangleMesh start, LoadSceneMesh(scene, 0));
  TESSERA_RETURN_IF_ERROR(add("start", start));
  if (const std::string peer = scene.folder + "/peer_refined.ply"; fs::exists(peer)) {
    TESSERA_ASSIGN_OR_RETURN(const TriangleMesh mesh, ReadLocalMesh(peer, scene.frame));
    TESSERA_RETURN_IF_ERROR(add("peer", mesh));
  }

  const std::string work = absl::StrCat(arguments.out, "/results/", table.scene);
  SceneRunner runner(scene.folder, work, scene.frame);
  for (const Variant& variant : variants) {
    // What does not ask for likelihoods is the same on all rungs.
    if (!arguments.rungs.empty() && variant.settings.method != "baseline") continue;
    TESSERA_ASSIGN_OR_RETURN(const SceneRunner::Result result, runner.Run(variant.name, variant.settings));
    TESSERA_RETURN_IF_ERROR(add(variant.name, result.mesh));
    table.rows.back().cpu_s = result.all_cpu_s();
    if (arguments.no_folds) continue;
    TESSERA_ASSIGN_OR_RETURN(const City city, runner.Start());
    TESSERA_ASSIGN_OR_RETURN(FoldCounter folds, FoldCounter::Create(city.mesh));
    TESSERA_ASSIGN_OR_RETURN(table.rows[0].folds, folds.Count(city.mesh));
    TESSERA_ASSIGN_OR_RETURN(table.rows.back().folds, folds.Count(result.mesh));
  }
  for (size_t r = 0; r < arguments.rungs.size(); ++r) {
    const std::string rung = absl::StrCat(arguments.out, "/rungs/", table.scene, "/", r);
    TESSERA_RETURN_IF_ERROR(MakeRung(scene, arguments.rungs[r], rung));
    SceneRunner rung_runner(rung, absl::StrCat(work, "/rungs/", r), scene.frame);
    for (const Variant& variant : variants) {
      if (variant.settings.method == "baseline") continue;
      TESSERA_ASSIGN_OR_RETURN(const SceneRunner::Result result, rung_runner.Run(variant.name, variant.settings));
      TESSERA_RETURN_IF_ERROR(add(absl::StrCat(arguments.rungs[r], ": ", variant.name), result.mesh));
      table.rows.back().cpu_s = result.all_cpu_s();
    }
  }
  if (arguments.drift) {
    const std::string from_truth = absl::StrCat(arguments.out, "/from_truth/", table.scene);
    TESSERA_RETURN_IF_ERROR(StartFromTruth(scene, from_truth));
    SceneRunner truth_runner(from_truth, work + "/from_truth", scene.frame);
    for (const Variant& variant : variants) {
      TESSERA_ASSIGN_OR_RETURN(const SceneRunner::Result result, truth_runner.Run(variant.name, variant.settings));
      TESSERA_RETURN_IF_ERROR(add("from truth: " + variant.name, result.mesh));
    }
  }
  return table;
}

// Each row's mean capped distances over the baseline's, of the mesh and of the truth.
void PrintLadder(const AccuracyTable& table) {
  const SurfaceScores* baseline = nullptr;
  for (const AccuracyRow& row : table.rows) {
    if (row.name == "baseline") baseline = &row.evaluation.surface;
  }
  if (baseline == nullptr) return;
  std::printf("\n%-44s|%22s|%22s\n", "beside the baseline", "accuracy", "completeness");
  for (const AccuracyRow& row : table.rows) {
    const SurfaceScores& s = row.evaluation.surface;
    std::printf("%-44.44s|%13.4f  %.3f |%13.4f  %.3f\n", row.name.c_str(), s.accuracy.capped_mean_m,
                s.accuracy.capped_mean_m / baseline->accuracy.capped_mean_m, s.completeness.capped_mean_m,
                s.completeness.capped_mean_m / baseline->completeness.capped_mean_m);
  }
}

void PrintDrift(const AccuracyTable& table) {
  for (const AccuracyRow& row : table.rows) {
    if (!row.name.starts_with("from truth: ")) continue;
    std::printf("drift, %s: mean distance to the truth %.3f GSD\n", row.name.c_str(),
                row.evaluation.surface.accuracy.mean_m / table.gsd_m);
  }
}

Status BenchLeftOut(const std::string& folder, const std::vector<Variant>& variants, const Arguments& arguments) {
  Warnings warnings;
  TESSERA_ASSIGN_OR_RETURN(const SceneDescription scene, LoadScene(folder, &warnings));
  const size_t view = static_cast<size_t>(arguments.leave_out);
  if (view >= scene.views.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("--leave-out: found ", view, ", expected less than ", scene.views.size()));
  }
  const std::string name = absl::StrCat(fs::path(scene.folder).filename().string(), "_without_", view);
  const std::string left_out = absl::StrCat(arguments.out, "/left_out/", name);
  TESSERA_RETURN_IF_ERROR(LeaveOutView(scene, view, left_out));
  std::vector<std::pair<std::string, TriangleMesh>> meshes;
  TESSERA_ASSIGN_OR_RETURN(TriangleMesh start, LoadSceneMesh(scene, 0));
  meshes.push_back({"start", std::move(start)});
  if (const std::string peer = scene.folder + "/peer_refined.ply"; fs::exists(peer)) {
    TESSERA_ASSIGN_OR_RETURN(TriangleMesh mesh, ReadLocalMesh(peer, scene.frame));
    meshes.push_back({"peer (saw the view)", std::move(mesh)});
  }
  SceneRunner runner(left_out, absl::StrCat(arguments.out, "/results/", name), scene.frame);
  std::vector<double> cpu_s(meshes.size(), 0);
  for (const Variant& variant : variants) {
    TESSERA_ASSIGN_OR_RETURN(SceneRunner::Result result, runner.Run(variant.name, variant.settings));
    meshes.push_back({variant.name, std::move(result.mesh)});
    cpu_s.push_back(result.all_cpu_s());
  }
  std::vector<const TriangleMesh*> pointers;
  for (const auto& [label, mesh] : meshes) pointers.push_back(&mesh);
  TESSERA_ASSIGN_OR_RETURN(const LeftOutScore score, ScoreLeftOutView(scene, view, pointers));
  std::printf("\n%s: %s left out; %d neighbours, %.2f million windows that are whole on all meshes\n",
              scene.folder.c_str(), scene.views[view].name.c_str(), score.neighbours, 1e-6 * score.pixels);
  std::printf("%-44s|%10s|%8s\n", "", "mean ZNCC", "CPU s");
  for (size_t m = 0; m < meshes.size(); ++m) {
    std::printf("%-44.44s|%10.4f|%8.1f\n", meshes[m].first.c_str(), score.mean_zncc[m], cpu_s[m]);
  }
  return absl::OkStatus();
}

Status Bench(Arguments arguments) {
  const ThreadLimit limit(arguments.threads);
  TESSERA_ASSIGN_OR_RETURN(const std::vector<Variant> variants,
                           arguments.ablation ? MakeAblation(arguments) : MakeVariants(arguments));
  if (arguments.leave_out >= 0) {
    for (const std::string& scene : arguments.scenes) {
      TESSERA_RETURN_IF_ERROR(BenchLeftOut(scene, variants, arguments));
    }
    return absl::OkStatus();
  }
  if (std::sscanf(arguments.blocks.c_str(), "%dx%d", &arguments.synth.columns, &arguments.synth.rows) != 2) {
    return absl::InvalidArgumentError("--blocks: expected COLUMNSxROWS");
  }
  std::vector<std::pair<std::string, bool>> scenes;
  for (const uint64_t seed : arguments.seeds) {
    arguments.synth.seed = seed;
    scenes.push_back({absl::StrCat(arguments.out, "/cities/seed_", seed), true});
    TESSERA_RETURN_IF_ERROR(EnsureCity(arguments.synth, scenes.back().first));
  }
  for (const std::string& scene : arguments.scenes) scenes.push_back({scene, false});
  std::vector<AccuracyTable> tables;
  for (const auto& [folder, synthetic] : scenes) {
    TESSERA_ASSIGN_OR_RETURN(AccuracyTable table, BenchScene(folder, synthetic, variants, arguments));
    Print(table);
    PrintDrift(table);
    if (!arguments.rungs.empty()) PrintLadder(table);
    tables.push_back(std::move(table));
  }
  PrintRatios(tables);
  std::printf("\nCPU in all, measuring included: %.0f s; meshes: %s/results\n", CpuSeconds(), arguments.out.c_str());
  return absl::OkStatus();
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) {
  CLI::App app("Accuracy of the methods against the truth, on synthetic cities and scenes with a truth");
  tessera::Arguments a;
  app.add_option("--out", a.out, "folder for cities (kept and used again) and results")->required();
  app.add_option("--seeds", a.seeds, "synthetic cities")->delimiter(',')->allow_extra_args(false);
  app.add_option("--blocks", a.blocks, "of the synthetic cities, COLUMNSxROWS")->capture_default_str();
  app.add_option("--gsd", a.synth.gsd_m, "of the synthetic cities, metres")->capture_default_str();
  app.add_option("--scene", a.scenes, "folder of a scene with a truth; may be given again")->allow_extra_args(false);
  app.add_option("--methods", a.methods)->delimiter(',')->allow_extra_args(false)->capture_default_str();
  app.add_option("--settings", a.settings, "of all methods, as JSON: {\"thin_plate\":0.5,\"levels\":[1,0]}");
  app.add_option("--sweep", a.sweep, "NAME=VALUE,VALUE,...: a row of each method for every value of a setting");
  app.add_flag("--ablation", a.ablation, "instead of --methods: ours, and ours without each of its terms");
  app.add_option(
         "--rungs", a.rungs,
         "truth,grown=3,shrunk=3,start,permuted,uniform,shipped,FOLDER: methods that use likelihoods with these")
      ->delimiter(',')
      ->allow_extra_args(false);
  app.add_option("--rounds", a.rounds, "0: the methods' own");
  app.add_option("--tiles", a.tiles)->capture_default_str();
  app.add_option("--threads", a.threads, "0: one for each core");
  app.add_option("--leave-out", a.leave_out, "index of a view: run the scenes without it and compare with it");
  app.add_flag("--drift", a.drift, "also start every method from the truth");
  app.add_flag("--no-folds", a.no_folds, "do not count inverted faces and self-intersections");
  CLI11_PARSE(app, argc, argv);
  const tessera::Status status = tessera::Bench(std::move(a));
  if (!status.ok()) std::fprintf(stderr, "accuracy_bench: %s\n", status.ToString().c_str());
  return status.ok() ? 0 : 1;
}
