// Refines one scene in one piece and prints energies, times and nanoseconds per pixel and pair:
//   refine_bench SCENE [--out RESULT.ply] [--levels 2,1,0 --iterations 4,8,6] [--thin-plate W] ...
// Score the result with `tessera evaluate RESULT.ply --scene SCENE`.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/parallel.h"
#include "common/geometry/repair.h"
#include "common/imaging/image_io.h"
#include "common/meshio/ply.h"
#include "common/scene/repair_options.h"
#include "common/scene/scene.h"
#include "tests/support/held_pixels.h"
#include "tests/support/refine_surface.h"
#include "worker/refine/density.h"
#include "worker/refine/descent.h"
#include "worker/refine/self_intersection.h"

namespace tessera {
namespace {

// Seconds of CPU, all threads together: stages compare even on a busy machine.
class CpuClock : public SystemClock {
 public:
  int64_t MonotonicUs() const override {
    return static_cast<int64_t>(1e6 * static_cast<double>(std::clock()) / CLOCKS_PER_SEC);
  }
};

struct Arguments {
  std::string scene, out;
  double max_footprint_px2 = DensityOptions().max_footprint_px2;
  int threads = 0;
  double best_angle_deg = 15;
  SurfaceProblem problem;
  TileRefineOptions refine;
};

void AddOptions(CLI::App& app, Arguments& a) {
  app.add_option("scene", a.scene, "folder of the scene")->required();
  app.add_option("--out", a.out, "refined mesh (PLY)");
  app.add_option("--footprint", a.max_footprint_px2, "largest face, square pixels");
  app.add_option("--threads", a.threads, "0: one for each core");
  app.add_option("--levels", a.problem.levels)->delimiter(',');
  app.add_option("--iterations", a.problem.iterations)->delimiter(',');
  app.add_option("--window", a.refine.data.window_px);
  app.add_option("--gaussian", a.refine.data.gaussian_window);
  app.add_option("--noise-variance", a.refine.data.photo.window.noise_variance);
  app.add_option("--thin-plate", a.refine.step.thin_plate);
  app.add_option("--photo-outlier", a.refine.data.photo.window.outlier);
  app.add_option("--membrane", a.refine.step.membrane);
  app.add_option("--rim", a.refine.step.rim);
  app.add_option("--sweeps", a.refine.step.smoothing_sweeps);
  app.add_option("--max-step", a.refine.step.max_step_px);
  app.add_option("--step-decay", a.refine.step.step_decay);
  app.add_option("--partners", a.problem.pairing.partners);
  app.add_option("--best-angle", a.best_angle_deg);
  app.add_option("--occlusion", a.refine.data.photo.occlusion_px);
  app.add_option("--max-normal", a.refine.step.max_normal_gsd);
  app.add_option("--max-tangent", a.refine.step.max_tangent_gsd);
  app.add_option("--start-steps", a.refine.step.start_smoothing_steps);
  app.add_option("--start-cosine", a.refine.step.min_start_cosine);
}

// What the run did to the surface that a surface must not suffer.
void PrintFolds(const SurfaceProblem& problem, const std::vector<Eigen::Vector3d>& vertices, int start_steps) {
  const CpuClock clock;
  MotionLimits limits;
  limits.start_smoothing_steps = start_steps;
  const MotionGuard guard(problem.mesh, problem.boundary, limits);
  const int64_t begin_us = clock.MonotonicUs();
  const std::vector<FacePair> before = IntersectingFacePairs(problem.mesh);
  const int64_t between_us = clock.MonotonicUs();
  const std::vector<FacePair> after = IntersectingFacePairs(TriangleMesh{vertices, problem.mesh.faces, {}});
  const int64_t end_us = clock.MonotonicUs();
  std::printf("faces against the smoothed start: %ld at the start, %ld after\n",
              static_cast<long>(guard.InvertedFaces(problem.mesh.vertices)),
              static_cast<long>(guard.InvertedFaces(vertices)));
  std::printf("intersecting pairs: %zu at the start, %zu after, %zu of them new (cpu %.2f, %.2f s)\n", before.size(),
              after.size(), NewPairs(before, after).size(), 1e-6 * static_cast<double>(between_us - begin_us),
              1e-6 * static_cast<double>(end_us - between_us));
}

Status Bench(Arguments& a) {
  Warnings warnings;
  TESSERA_ASSIGN_OR_RETURN(const SceneDescription scene, LoadScene(a.scene, &warnings));
  TESSERA_ASSIGN_OR_RETURN(const TriangleMesh start, LoadSceneMesh(scene, 0));
  SurfaceProblem& problem = a.problem;
  constexpr double kRadians = 3.14159265358979323846 / 180;
  problem.pairing.min_angle_rad = 2.5 * kRadians;
  problem.pairing.max_angle_rad = 45 * kRadians;
  problem.pairing.best_angle_rad = a.best_angle_deg * kRadians;
  TESSERA_ASSIGN_OR_RETURN(problem.gsd_m, MedianGsd(scene, start));
  problem.up = scene.up_in_local;
  std::vector<FloatImage> images;
  std::vector<PosedCamera> cameras;
  for (const SceneView& view : scene.views) {
    TESSERA_ASSIGN_OR_RETURN(FloatImage image, ReadLuminance(scene.folder + "/" + view.image_path, view.lens));
    images.push_back(std::move(image));
    cameras.push_back(view.camera);
  }
  for (size_t i = 0; i < cameras.size(); ++i)
    problem.views.push_back({cameras[i], std::make_shared<HeldPixels>(images[i])});
  DensityOptions density;
  density.max_footprint_px2 = a.max_footprint_px2;
  TESSERA_ASSIGN_OR_RETURN(RepairedMesh repaired,
                           RepairMesh(start, RepairOptionsOf(scene.views, scene.frame), &warnings));
  problem.mesh = SplitLargeFaces(repaired.mesh, cameras, density).mesh;
  std::printf("views %zu  gsd %.4f m  faces %zu -> %zu\n", cameras.size(), problem.gsd_m, start.faces.size(),
              problem.mesh.faces.size());

  const CpuClock clock;
  const double begin_s = 1e-6 * static_cast<double>(clock.MonotonicUs());
  TESSERA_ASSIGN_OR_RETURN(const SurfaceRefinement refined, RefineSurface(problem, a.refine, TaskControl(), clock));
  const TileRefinement& report = refined.tile;
  const std::vector<Eigen::Vector3d>& vertices = refined.vertices;
  const double cpu_s = 1e-6 * static_cast<double>(clock.MonotonicUs()) - begin_s;
  double pixel_pairs = 0;
  for (const nlohmann::json& round : nlohmann::json::parse(report.state.report).at("rounds")) {
    pixel_pairs += round.value("warped_pixels", 0.0);
    std::printf("energy on the finest level %.5f -> %.5f\n", round.value("photo_energy_start", 0.0),
                round.value("photo_energy_end", 0.0));
  }
  double moved_rms_m = 0, moved_max_m = 0;
  for (size_t v = 0; v < vertices.size(); ++v) {
    const double moved_m = (vertices[v] - problem.mesh.vertices[v]).norm();
    moved_rms_m += moved_m * moved_m / static_cast<double>(vertices.size());
    moved_max_m = std::max(moved_max_m, moved_m);
  }
  std::printf("moved rms %.3f m, max %.2f m  pairs %d\n", std::sqrt(moved_rms_m), moved_max_m, refined.pairs);
  std::printf("cpu %.1f s: loading %.1f, visibility %.1f, photo %.1f, step %.1f, repair %.2f\n", cpu_s,
              report.seconds_loading, report.seconds_visibility, report.seconds_data, report.seconds_step,
              report.seconds_repair);
  std::printf("cpu ns a pixel, ordered pair and evaluation: photo %.1f, all %.1f\n",
              1e9 * report.seconds_data / pixel_pairs, 1e9 * cpu_s / pixel_pairs);
  PrintFolds(problem, vertices, a.refine.step.start_smoothing_steps);
  if (a.out.empty()) return absl::OkStatus();
  problem.mesh.vertices = vertices;
  for (Eigen::Vector3d& v : problem.mesh.vertices) v = scene.frame.SceneFromLocal(v);
  return WritePly(a.out, problem.mesh);
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) {
  CLI::App app("Refines one scene in one piece and tells what it cost");
  tessera::Arguments arguments;
  tessera::AddOptions(app, arguments);
  CLI11_PARSE(app, argc, argv);
  const tessera::ThreadLimit limit(arguments.threads);
  const tessera::Status status = tessera::Bench(arguments);
  if (!status.ok()) std::fprintf(stderr, "refine_bench: %s\n", status.ToString().c_str());
  return status.ok() ? 0 : 1;
}
