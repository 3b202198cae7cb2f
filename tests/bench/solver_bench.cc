// solver_bench [--faces 1000000] [--classes 4] [--small 50000] [--seeds 2] [--only KIND]: what labelling costs, in
// seconds of CPU a million faces on one thread, on fields with the structure of a mesh's from clear to hopeless; and
// how far its energy is from that of CGAL's alpha expansion ("gap to e") and from the best known ("gap": also expansion
// from our labels, and our own solver with other numbers of iterations) on smaller ones, in percent of
// E(start) - E(best). The start: every face its own best label.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <numeric>
#include <string>
#include <vector>

#include "common/base/parallel.h"
#include "common/base/random.h"
#include "tests/support/alpha_expansion.h"
#include "tests/support/label_energy.h"
#include "tests/support/mesh_field.h"
#include "worker/label/belief_propagation.h"

namespace tessera {
namespace {

double CpuSeconds() {
  timespec time;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

struct Kind {
  const char* name;
  double contrast, face_noise, coupling, wrong_area, unseen_area;
};
constexpr Kind kKinds[] = {
    {"clear", 3, 0.5, 0.5, 0.05, 0.02},    {"as real", 2, 1, 0.5, 0.12, 0.1},     {"noisy", 1.5, 1.5, 0.8, 0.15, 0.15},
    {"half unseen", 2, 1, 0.5, 0.15, 0.5}, {"strong Potts", 1, 1, 1.5, 0.2, 0.2}, {"weak costs", 0.5, 0.7, 1, 0.3, 0.2},
    {"only noise", 0, 1, 0.5, 0, 0},
};

// As many edges as a mesh has, between any two faces.
LabelField RandomField(int faces, int classes, double coupling, uint64_t seed) {
  Random random(seed);
  LabelField field;
  field.classes = classes;
  for (int64_t i = 0; i < int64_t{faces} * classes; ++i)
    field.unary.push_back(static_cast<float>(random.Uniform(0, 2)));
  for (int e = 0; e < faces * 3 / 2; ++e) {
    const uint32_t a = static_cast<uint32_t>(random.Below(faces)), b = static_cast<uint32_t>(random.Below(faces));
    if (a != b) field.edges.push_back({a, b, static_cast<float>(coupling * random.Uniform())});
  }
  return field;
}

struct Bench {
  bool expansion = true;
  int small = 50000, seeds = 2;
  std::string only;  // one kind of field
  double worst_gap = -1e9, worst_seconds = 0;

  void Gap(const std::string& name, const LabelField& field) {
    const std::vector<int32_t> none(field.faces(), -1);
    const double before = CpuSeconds();
    const Labelling solved = SolveLabels(field, none, {});
    const double seconds = CpuSeconds() - before;
    std::vector<int32_t> start(field.faces());
    for (size_t f = 0; f < start.size(); ++f) {
      const float* unary = &field.unary[f * field.classes];
      start[f] = static_cast<int32_t>(std::min_element(unary, unary + field.classes) - unary);
    }
    const double expansion_before = CpuSeconds();
    const double expanded = LabelEnergy(field, ExpandLabels(field, start));
    const double expansion_seconds = CpuSeconds() - expansion_before;
    const double from_ours = LabelEnergy(field, ExpandLabels(field, solved.labels));
    const double start_energy = LabelEnergy(field, start), energy = LabelEnergy(field, solved.labels);
    double best = std::min({expanded, from_ours, energy});
    for (const int iterations : {20, 60, 100}) {
      const Labelling longer = SolveLabels(field, none, {.iterations = iterations, .expansion_rounds = 10});
      best = std::min(best, LabelEnergy(field, longer.labels));
    }
    const double gap = 100 * (energy - best) / std::max(start_energy - best, 1e-9);
    const double plain = 100 * (energy - expanded) / std::max(start_energy - best, 1e-9);
    worst_gap = std::max(worst_gap, gap);
    std::printf("%-14s %8zu %12.1f %12.2f %12.2f %12.2f %9.4f %9.4f %7.2f %7.1f\n", name.c_str(), field.faces(),
                start_energy, energy, expanded, from_ours, plain, gap, 1e6 * seconds / field.faces(),
                1e6 * expansion_seconds / field.faces());
    std::fflush(stdout);
  }

  void Gaps(int classes) {
    std::printf("%-14s %8s %12s %12s %12s %12s %9s %9s %7s %7s\n", "field", "faces", "E start", "E ours", "E expansion",
                "E exp(ours)", "gap to e%", "gap %", "s/M", "exp s/M");
    for (const Kind& kind : kKinds) {
      if (!only.empty() && only != kind.name) continue;
      for (int seed = 1; seed <= seeds; ++seed) {
        Gap(kind.name, MakeMeshField({.faces = small,
                                      .classes = classes,
                                      .seed = static_cast<uint64_t>(seed),
                                      .contrast = kind.contrast,
                                      .face_noise = kind.face_noise,
                                      .wrong_area = kind.wrong_area,
                                      .unseen_area = kind.unseen_area,
                                      .coupling = kind.coupling}));
      }
    }
    for (const double coupling : {0.5, 1.0, 2.0}) {
      for (int seed = 1; seed <= seeds; ++seed) {
        Gap("random graph", RandomField(small / 5, classes, coupling, seed));
      }
    }
    std::printf("worst gap: %.4f %%\n\n", worst_gap);
  }

  void Times(int faces, int classes) {
    std::printf("%-14s %8s %9s %9s %12s\n", "field", "faces", "order", "CPU s/M", "E ours");
    for (const bool shuffled : {false, true}) {
      for (const Kind& kind : kKinds) {
        if (!only.empty() && only != kind.name) continue;
        const LabelField field = MakeMeshField({.faces = faces,
                                                .classes = classes,
                                                .contrast = kind.contrast,
                                                .face_noise = kind.face_noise,
                                                .wrong_area = kind.wrong_area,
                                                .unseen_area = kind.unseen_area,
                                                .coupling = kind.coupling,
                                                .shuffled = shuffled});
        const std::vector<int32_t> none(field.faces(), -1);
        const double before = CpuSeconds();
        const Labelling solved = SolveLabels(field, none, {});
        const double seconds = 1e6 * (CpuSeconds() - before) / field.faces();
        worst_seconds = std::max(worst_seconds, seconds);
        std::printf("%-14s %8zu %9s %9.2f %12.1f\n", kind.name, field.faces(), shuffled ? "shuffled" : "rows", seconds,
                    LabelEnergy(field, solved.labels));
        std::fflush(stdout);
      }
    }
    std::printf("worst: %.2f s of CPU a million faces\n", worst_seconds);
  }
};

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) {
  tessera::Bench bench;
  int faces = 1000000, classes = 4;
  CLI::App app{"Labelling: seconds a million faces, and the gap to alpha expansion."};
  app.add_option("--faces", faces, "faces of the fields that are timed; 0: none");
  app.add_option("--classes", classes, "classes");
  app.add_option("--small", bench.small, "faces of the fields that alpha expansion solves too; 0: none");
  app.add_option("--seeds", bench.seeds, "fields of each kind");
  app.add_option("--only", bench.only, "one kind of mesh field");
  CLI11_PARSE(app, argc, argv);
  const tessera::ThreadLimit one(1);
  if (bench.small > 0) bench.Gaps(classes);
  if (faces > 0) bench.Times(faces, classes);
}
