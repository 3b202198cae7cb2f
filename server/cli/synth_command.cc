#include <CLI/CLI.hpp>
#include <array>
#include <chrono>
#include <cstdio>
#include <memory>
#include <string>

#include "common/base/parallel.h"
#include "common/base/printable.h"
#include "common/synth/synth.h"
#include "server/cli/commands.h"
#include "server/display/stage_line.h"

namespace tessera {
namespace {

struct SynthArguments {
  std::string folder;
  std::string blocks;
  std::string image_size;
  uint64_t seed = 1;
  double gsd_m = 0;
  std::string change, part;
  uint64_t change_seed = 1;
  bool whole = false, new_mesh = false, unchanged = false;
  bool toy = false, no_images = false, force = false, quiet = false;
  int threads = 0;
};

// "AxB" as two positive numbers.
bool ParsePair(const std::string& text, int* a, int* b) {
  char rest = 0;
  return std::sscanf(text.c_str(), "%dx%d%c", a, b, &rest) == 2 && *a > 0 && *b > 0;
}

double Seconds(std::chrono::steady_clock::time_point since) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - since).count();
}

// "A,B,C,D" as four numbers.
bool ParseFour(const std::string& text, std::array<double, 4>* four) {
  char rest = 0;
  return std::sscanf(text.c_str(), "%lf,%lf,%lf,%lf%c", &(*four)[0], &(*four)[1], &(*four)[2], &(*four)[3], &rest) == 4;
}

void PrintReport(const SynthOptions& options, const SynthReport& r, double seconds) {
  std::printf("blocks                          %d x %d, %.2f ha\n", options.columns, options.rows, r.area_m2 / 1e4);
  std::printf("images                          %lld of %d x %d px\n", static_cast<long long>(r.images),
              options.image_width_px, options.image_height_px);
  std::printf("GSD                             %.3f m\n", r.gsd_m);
  std::printf("sparse points                   %lld\n", static_cast<long long>(r.sparse_points));
  std::printf("faces, truth                    %lld\n", static_cast<long long>(r.truth_faces));
  std::printf("faces, start                    %lld\n", static_cast<long long>(r.start_faces));
  std::printf("difficulty (the same for every city)\n");
  std::printf("  voxel                         %.2f m = %.0f GSD\n", r.voxel_m, r.voxel_m / r.gsd_m);
  std::printf("  start labels, average accuracy  %.3f by area (.82-.86)", r.start_accuracy_by_area);
  if (r.images > 0) {
    std::printf(", %.3f by pixels, displaced surfaces included\n", r.start_accuracy_by_pixels);
    std::printf("  likelihoods, argmax accuracy    %.3f (.85-.90)\n", r.likelihood_accuracy);
  } else {
    std::printf("\n");
  }
  std::printf("seconds                         %.1f\n", seconds);
}

void PrintChanges(const SynthReport& r, double seconds) {
  std::printf("images                          %lld\n", static_cast<long long>(r.images));
  std::printf("GSD                             %.3f m\n", r.gsd_m);
  std::printf("sparse points                   %lld\n", static_cast<long long>(r.sparse_points));
  std::printf("faces, truth                    %lld\n", static_cast<long long>(r.truth_faces));
  if (r.start_faces > 0) std::printf("faces, start                    %lld\n", static_cast<long long>(r.start_faces));
  static constexpr const char* kKinds[] = {"built", "demolished", "grown", "felled", "label"};
  std::printf("changes\n");
  for (size_t k = 0; k < r.changes.size(); ++k) {
    std::printf("  %-30s%lld\n", kKinds[k], static_cast<long long>(r.changes[k]));
  }
  std::printf("likelihoods, argmax accuracy    %.3f (.85-.90)\n", r.likelihood_accuracy);
  std::printf("seconds                         %.1f\n", seconds);
}

int RunSynth(const SynthArguments& arguments) {
  SynthOptions options;
  options.seed = arguments.seed;
  options.with_images = !arguments.no_images;
  options.overwrite = arguments.force;
  std::string blocks = arguments.blocks, size = arguments.image_size;
  if (arguments.toy) {
    options.columns = options.rows = 1;
    options.gsd_m = 0.3;
    options.image_width_px = 320;
    options.image_height_px = 240;
  }
  if (arguments.gsd_m > 0) options.gsd_m = arguments.gsd_m;
  if (!blocks.empty() && !ParsePair(blocks, &options.columns, &options.rows)) {
    std::fprintf(stderr, "--blocks: found '%s', expected COLUMNSxROWS as in 2x2\n", blocks.c_str());
    return kExitUsage;
  }
  if (!size.empty() && !ParsePair(size, &options.image_width_px, &options.image_height_px)) {
    std::fprintf(stderr, "--image-size: found '%s', expected WIDTHxHEIGHT as in 1000x750\n", size.c_str());
    return kExitUsage;
  }
  SecondEpochOptions later;
  later.base_folder = arguments.change;
  later.seed = arguments.change_seed;
  later.changes = !arguments.unchanged;
  later.whole = arguments.whole;
  later.new_mesh = arguments.new_mesh;
  later.overwrite = arguments.force;
  if (!arguments.part.empty() && !ParseFour(arguments.part, &later.part)) {
    std::fprintf(stderr, "--part: found '%s', expected X0,Y0,X1,Y1 as in 0.3,0.3,0.7,0.7\n", arguments.part.c_str());
    return kExitUsage;
  }
  const bool is_later = !arguments.change.empty();
  std::unique_ptr<ThreadLimit> limit;
  if (arguments.threads > 0) limit = std::make_unique<ThreadLimit>(arguments.threads);
  const auto start = std::chrono::steady_clock::now();
  StatusOr<SynthReport> report = absl::InternalError("not run");
  {
    StageLine line(!arguments.quiet);
    TaskControl control;
    control.report = [&](double fraction, const std::string& stage) { line.Show(fraction, stage); };
    report = is_later ? SynthesizeSecondEpoch(later, arguments.folder, control)
                      : SynthesizeCity(options, arguments.folder, control);
  }
  if (!report.ok()) {
    std::fprintf(stderr, "tessera synth: %s\n", PrintableLines(std::string(report.status().message())).c_str());
    return report.status().code() == absl::StatusCode::kInvalidArgument ? kExitUsage : kExitFailed;
  }
  if (arguments.quiet) return kExitOk;
  if (is_later) {
    PrintChanges(*report, Seconds(start));
  } else {
    PrintReport(options, *report, Seconds(start));
  }
  return kExitOk;
}

}  // namespace

void AddSynthCommand(CLI::App& app, int* exit_code) {
  CLI::App* command = app.add_subcommand("synth", "Make a procedural city with exact truth, ready to be refined");
  auto arguments = std::make_shared<SynthArguments>();
  command->add_option("CITY", arguments->folder, "Folder to write the scene into")->required();
  CLI::App* epoch = command->add_option_group("later", "A later epoch of a city");
  CLI::Option* change = epoch->add_option("--change", arguments->change,
                                          "The city in this folder one year later: some things changed, new images");
  epoch
      ->add_option("--part", arguments->part, "X0,Y0,X1,Y1, what is flown over (default 0.3,0.3,0.7,0.7 of the extent)")
      ->needs(change);
  epoch->add_option("--change-seed", arguments->change_seed, "Other changes (default 1)")->needs(change);
  epoch->add_flag("--unchanged", arguments->unchanged, "New images of the city as it was; the seed is the flight's")
      ->needs(change);
  epoch->add_flag("--whole", arguments->whole, "With the city's own images and start mesh, not the new images alone")
      ->needs(change);
  epoch->add_flag("--new-mesh", arguments->new_mesh, "As --whole, with a start mesh of the changed city")
      ->needs(change);
  command->add_option("--blocks", arguments->blocks, "COLUMNSxROWS blocks of 44 m (default 2x2)")->excludes(change);
  command->add_option("--seed", arguments->seed, "Same seed, same bytes")->capture_default_str()->excludes(change);
  command->add_option("--gsd", arguments->gsd_m, "Ground sampling distance in metres (default 0.12)")->excludes(change);
  command->add_option("--image-size", arguments->image_size, "WIDTHxHEIGHT in pixels (default 1000x750)")
      ->excludes(change);
  command->add_option("--threads", arguments->threads, "Threads to use (default: one for each core)");
  command->add_flag("--toy", arguments->toy, "Other defaults: one block, GSD 0.3, 320x240; a few seconds")
      ->excludes(change);
  command->add_flag("--no-images", arguments->no_images, "Meshes and cameras only")->excludes(change);
  command->add_flag("--force", arguments->force, "Overwrite the scene in CITY");
  command->add_flag("--quiet", arguments->quiet, "No progress and no table");
  command->footer(
      "Examples:\n"
      "  tessera synth city                            two by two blocks, about 50 images\n"
      "  tessera synth toy --toy --seed 3              the smallest, for tests\n"
      "  tessera synth town --blocks 8x6 --image-size 3000x2000\n"
      "  tessera synth wide --blocks 40x40 --no-images   3 square kilometres of meshes\n"
      "  tessera synth next --change city              the city a year later, its new images alone\n"
      "  tessera synth next --change city --part 0.2,0.4,0.6,0.8 --whole\n"
      "How hard the start mesh and the likelihoods are is fixed; no option changes it.");
  command->callback([arguments, exit_code] { *exit_code = RunSynth(*arguments); });
}

}  // namespace tessera
