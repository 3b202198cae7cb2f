// `tessera synth`: makes a procedural city with exact truth.
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
  CLI::App* command = app.add_subcommand("synth", "Make a procedural city with exact truth");
  auto arguments = std::make_shared<SynthArguments>();
  command->add_option("CITY", arguments->folder, "Folder to write the scene into")->required();
  CLI::App* epoch = command->add_option_group("Later epoch", "Make a later epoch of an existing city");
  CLI::Option* change = epoch->add_option("--change", arguments->change,
                                          "Base city: make it one year later, with changed objects and new images");
  epoch
      ->add_option("--part", arguments->part,
                   "Covered rectangle X0,Y0,X1,Y1 as fractions of the extent (default 0.3,0.3,0.7,0.7)")
      ->needs(change);
  epoch->add_option("--change-seed", arguments->change_seed, "Seed of the changes (default 1)")->needs(change);
  epoch
      ->add_flag("--unchanged", arguments->unchanged,
                 "Make new images without changes; --change-seed then varies the flight")
      ->needs(change);
  epoch->add_flag("--whole", arguments->whole, "Include the base city's images and start mesh")->needs(change);
  epoch
      ->add_flag("--new-mesh", arguments->new_mesh,
                 "Include the base city's images and a start mesh of the changed city")
      ->needs(change);
  command->add_option("--blocks", arguments->blocks, "Number of blocks of 44 m, COLUMNSxROWS (default 2x2)")
      ->excludes(change);
  command->add_option("--seed", arguments->seed, "Random seed; the same seed gives the same bytes")
      ->capture_default_str()
      ->excludes(change);
  command->add_option("--gsd", arguments->gsd_m, "Ground sampling distance in metres (default 0.12)")->excludes(change);
  command->add_option("--image-size", arguments->image_size, "Image size, WIDTHxHEIGHT in pixels (default 1000x750)")
      ->excludes(change);
  command->add_option("--threads", arguments->threads, "Number of threads (default: one per core)");
  command->add_flag("--toy", arguments->toy, "Use small defaults: one block, GSD 0.3 m, images of 320x240 pixels")
      ->excludes(change);
  command->add_flag("--no-images", arguments->no_images, "Write meshes and cameras only")->excludes(change);
  command->add_flag("--force", arguments->force, "Overwrite the scene in CITY");
  command->add_flag("--quiet", arguments->quiet, "Print neither progress nor the summary table");
  command->footer(
      "Examples:\n"
      "  tessera synth city                            2 x 2 blocks, about 50 images\n"
      "  tessera synth toy --toy --seed 3              smallest city, for tests\n"
      "  tessera synth town --blocks 8x6 --image-size 3000x2000\n"
      "  tessera synth wide --blocks 40x40 --no-images   3 square kilometres of meshes\n"
      "  tessera synth next --change city              one year later, new images only\n"
      "  tessera synth next --change city --part 0.2,0.4,0.6,0.8 --whole\n"
      "The error level of the start mesh and the likelihoods is fixed.");
  command->callback([arguments, exit_code] { *exit_code = RunSynth(*arguments); });
}

}  // namespace tessera
