// `tessera synth`: makes a procedural city with exact truth.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cstdio>
#include <memory>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/base/clock.h"
#include "common/base/elapsed.h"
#include "common/base/parallel.h"
#include "common/synth/city/epoch_changes.h"
#include "common/synth/synth.h"
#include "server/cli/command_line.h"
#include "server/cli/commands.h"
#include "server/display/stage_line.h"

namespace tessera {
namespace {

struct SynthArguments {
  std::string folder;
  std::string blocks;
  std::string image_size;
  std::string part;
  double gsd_m = 0;
  SynthOptions city;
  SecondEpochOptions later;
  bool unchanged = false;
  bool toy = false, no_images = false, force = false, quiet = false;
  int threads = 0;
};

// "AxB" as two positive numbers.
bool ParsePair(const std::string& text, int* a, int* b) {
  char rest = 0;
  return std::sscanf(text.c_str(), "%dx%d%c", a, b, &rest) == 2 && *a > 0 && *b > 0;
}

// "A,B,C,D" as four numbers.
bool ParseFour(const std::string& text, std::array<double, 4>* four) {
  char rest = 0;
  return std::sscanf(text.c_str(), "%lf,%lf,%lf,%lf%c", &(*four)[0], &(*four)[1], &(*four)[2], &(*four)[3], &rest) == 4;
}

void PrintRow(const std::string& name, const std::string& value) { absl::PrintF("%-32s%s\n", name, value); }

void PrintReport(const SynthOptions& options, const SynthReport& r) {
  PrintRow("blocks", absl::StrFormat("%d x %d, %.2f ha", options.columns, options.rows, r.area_m2 / 1e4));
  PrintRow("images", absl::StrFormat("%d of %d x %d px", r.images, options.image_width_px, options.image_height_px));
  PrintRow("GSD", absl::StrFormat("%.3f m", r.gsd_m));
  PrintRow("sparse points", absl::StrCat(r.sparse_points));
  PrintRow("faces, truth", absl::StrCat(r.truth_faces));
  PrintRow("faces, start", absl::StrCat(r.start_faces));
  absl::PrintF("difficulty (the same for every city)\n");
  PrintRow("  voxel", absl::StrFormat("%.2f m = %.0f GSD", r.voxel_m, r.voxel_m / r.gsd_m));
  absl::PrintF("  start labels, average accuracy  %.3f by area (.82-.86)", r.start_accuracy_by_area);
  if (r.images == 0) {
    absl::PrintF("\n");
    return;
  }
  absl::PrintF(", %.3f by pixels, displaced surfaces included\n", r.start_accuracy_by_pixels);
  PrintRow("  likelihoods, argmax accuracy", absl::StrFormat("  %.3f (.85-.90)", r.likelihood_accuracy));
}

void PrintChanges(const SynthReport& r) {
  PrintRow("images", absl::StrCat(r.images));
  PrintRow("GSD", absl::StrFormat("%.3f m", r.gsd_m));
  PrintRow("sparse points", absl::StrCat(r.sparse_points));
  PrintRow("faces, truth", absl::StrCat(r.truth_faces));
  if (r.start_faces > 0) PrintRow("faces, start", absl::StrCat(r.start_faces));
  absl::PrintF("changes\n");
  for (size_t k = 0; k < r.changes.size(); ++k) {
    PrintRow(absl::StrCat("  ", ChangeKindName(static_cast<ChangeKind>(k))), absl::StrCat(r.changes[k]));
  }
  PrintRow("likelihoods, argmax accuracy", absl::StrFormat("%.3f (.85-.90)", r.likelihood_accuracy));
}

int RunSynth(const SynthArguments& arguments) {
  SynthOptions options = arguments.city;
  options.with_images = !arguments.no_images;
  options.overwrite = arguments.force;
  if (arguments.toy) {
    options.columns = options.rows = 1;
    options.gsd_m = 0.3;
    options.image_width_px = 320;
    options.image_height_px = 240;
  }
  if (arguments.gsd_m > 0) options.gsd_m = arguments.gsd_m;
  const auto fault = [](const char* name, const std::string& found, const char* expected) {
    std::fprintf(stderr, "%s: found '%s', expected %s\n", name, found.c_str(), expected);
    return kExitUsage;
  };
  const std::string &blocks = arguments.blocks, &size = arguments.image_size;
  if (!blocks.empty() && !ParsePair(blocks, &options.columns, &options.rows)) {
    return fault("--blocks", blocks, "COLUMNSxROWS as in 2x2");
  }
  if (!size.empty() && !ParsePair(size, &options.image_width_px, &options.image_height_px)) {
    return fault("--image-size", size, "WIDTHxHEIGHT as in 1000x750");
  }
  SecondEpochOptions later = arguments.later;
  later.changes = !arguments.unchanged;
  later.overwrite = arguments.force;
  if (!arguments.part.empty() && !ParseFour(arguments.part, &later.part)) {
    return fault("--part", arguments.part, "X0,Y0,X1,Y1 as in 0.3,0.3,0.7,0.7");
  }
  const bool is_later = !later.base_folder.empty();
  const ThreadLimit limit(std::max(0, arguments.threads));
  const SystemClock clock;
  const int64_t start_us = clock.MonotonicUs();
  StatusOr<SynthReport> report = absl::InternalError("not run");
  {
    StageLine line(!arguments.quiet);
    TaskControl control;
    control.report = [&](double fraction, const std::string& stage) { line.Show(fraction, stage); };
    report = is_later ? SynthesizeSecondEpoch(later, arguments.folder, control)
                      : SynthesizeCity(options, arguments.folder, control);
  }
  if (!report.ok()) {
    ReportError("synth", report.status());
    return absl::IsInvalidArgument(report.status()) ? kExitUsage : kExitFailed;
  }
  if (arguments.quiet) return kExitOk;
  if (is_later) {
    PrintChanges(*report);
  } else {
    PrintReport(options, *report);
  }
  PrintRow("seconds", absl::StrFormat("%.1f", SecondsSince(clock, start_us)));
  return kExitOk;
}

}  // namespace

void AddSynthCommand(CLI::App& app, int* exit_code) {
  CLI::App* command = app.add_subcommand("synth", "Make a procedural city with exact truth");
  auto arguments = std::make_shared<SynthArguments>();
  command->add_option("CITY", arguments->folder, "Folder to write the scene into")->required();
  CLI::App* epoch = command->add_option_group("Later epoch", "Make a later epoch of an existing city");
  CLI::Option* change =
      epoch->add_option("--change", arguments->later.base_folder,
                        "Existing city: write the same city one year later, with changed objects and new images");
  epoch
      ->add_option("--part", arguments->part,
                   "Covered rectangle X0,Y0,X1,Y1 as fractions of the extent (default 0.3,0.3,0.7,0.7)")
      ->needs(change);
  epoch->add_option("--change-seed", arguments->later.seed, "Seed of the changes (default 1)")->needs(change);
  epoch
      ->add_flag("--unchanged", arguments->unchanged,
                 "Make new images without changes; --change-seed then varies the flight")
      ->needs(change);
  epoch->add_flag("--whole", arguments->later.whole, "Include the base city's images and start mesh")->needs(change);
  epoch
      ->add_flag("--new-mesh", arguments->later.new_mesh,
                 "Include the base city's images and a start mesh of the changed city")
      ->needs(change);
  command->add_option("--blocks", arguments->blocks, "Number of blocks of 44 m, COLUMNSxROWS (default 2x2)")
      ->excludes(change);
  command->add_option("--seed", arguments->city.seed, "Random seed; the same seed gives the same bytes")
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
