// Whether tiles can be told from the untiled run, and what that costs:
//   seam_bench --scene DIR --tiles 2,4,9 --out DIR
// runs the scene in one piece and in so many tiles, and prints whether the two results have the same bytes, how far
// their vertices are from each other in the seam band and over all, the share of the band's area whose label differs,
// how far band and interior are from the truth (if the scene has one), and processor time beside the untiled run's. The
// band is what lies within --band GSD of another tile's core.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/geometry/nearest_surface.h"
#include "common/job/task_parameters.h"
#include "common/scene/scene.h"
#include "common/storage/files.h"
#include "tests/bench/accuracy/bench_scenes.h"
#include "tests/bench/accuracy/scene_runner.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

constexpr double kCap_m = 0.5;  // of distances to the truth

struct Arguments {
  std::string scene, out, settings = "{}", method = kMethods[0];
  std::vector<int> tiles = {9};
  int threads = 0;
  double band_gsd = 48;
};

struct Spread {
  size_t count = 0;
  double rms = 0, p999 = 0, most = 0, same = 0;  // same: share of exactly equal values
};

Spread SpreadOf(std::vector<double> values) {
  Spread spread;
  if (values.empty()) return spread;
  double squares = 0;
  size_t zeros = 0;
  for (const double v : values) {
    squares += v * v;
    zeros += v == 0;
  }
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(0.999 * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  spread.count = values.size();
  spread.rms = std::sqrt(squares / static_cast<double>(values.size()));
  spread.p999 = *at;
  spread.most = *std::max_element(at, values.end());
  spread.same = static_cast<double>(zeros) / static_cast<double>(values.size());
  return spread;
}

std::vector<CellRect> CoresOf(const std::vector<PlannedTask>& tasks) {
  std::vector<CellRect> cores;
  for (const PlannedTask& task : tasks) {
    if (task.kind == "cut") cores.push_back(ParseCutParameters(task.parameters)->tile.core);
  }
  return cores;
}

// 1 for what lies within `band_m` of a core that is not its own.
std::vector<uint8_t> InBand(const std::vector<Eigen::Vector3d>& points, const GroundPlane& ground,
                            const std::vector<CellRect>& cores, double band_m) {
  std::vector<uint8_t> in_band(points.size(), 0);
  for (size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector2i cell = ground.Cell(points[i]);
    for (const CellRect& core : cores) {
      if (core.Contains(cell)) continue;
      in_band[i] |= DistanceToRect(ground.Coordinates(points[i]), core, ground.cell_m) < band_m;
    }
  }
  return in_band;
}

double MeanTruthDistance(const NearestSurface& truth, const std::vector<Eigen::Vector3d>& points,
                         const std::vector<uint8_t>& in_band, bool wanted) {
  std::vector<double> distances(points.size(), 0);
  ParallelFor(static_cast<int64_t>(points.size()), 1024, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      if (in_band[i] == wanted) distances[i] = std::min(kCap_m, truth.Find(points[i]).distance_m);
    }
  });
  double sum = 0, count = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    if (in_band[i] != wanted) continue;
    sum += distances[i];
    ++count;
  }
  return count > 0 ? sum / count : 0;
}

Status Bench(const Arguments& arguments) {
  const ThreadLimit limit(arguments.threads);
  Warnings warnings;
  TESSERA_ASSIGN_OR_RETURN(const SceneDescription scene, LoadScene(arguments.scene, &warnings));
  SceneRunner runner(scene.folder, arguments.out, scene.frame);
  TESSERA_ASSIGN_OR_RETURN(const MethodSettings settings, ParseMethodSettings(arguments.settings));
  JobSettings job = {.tiles = 1, .method = arguments.method, .method_settings = settings};
  TESSERA_ASSIGN_OR_RETURN(const SceneRunner::Result untiled, runner.Run("untiled", job));
  TESSERA_ASSIGN_OR_RETURN(const std::string untiled_bytes, ReadFile(arguments.out + "/untiled.ply"));
  TESSERA_ASSIGN_OR_RETURN(const City start, runner.Start());
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, runner.IngestedSurvey());
  std::optional<TriangleMesh> truth_mesh;
  std::optional<NearestSurface> truth;
  if (const std::string path = scene.folder + "/truth/mesh.ply"; fs::exists(path)) {
    TESSERA_ASSIGN_OR_RETURN(truth_mesh, ReadLocalMesh(path, scene.frame));
    truth.emplace(*truth_mesh);
  }
  std::vector<Eigen::Vector3d> centroids;
  for (size_t f = 0; f < start.mesh.faces.size(); ++f) centroids.push_back(MeshSpans(start.mesh).Centroid(f));

  std::printf("%s: %zu faces, GSD %.3f m, untiled %.1f CPU s; in GSD, band of %.0f\n", scene.folder.c_str(),
              start.mesh.faces.size(), survey.gsd_m, untiled.all_cpu_s(), arguments.band_gsd);
  std::printf("%5s | %5s | %9s %9s %9s %7s | %9s %9s %7s | %9s %9s | %7s %7s | %7s\n", "tiles", "bytes", "band RMS",
              "99.9 %", "most", "same", "all RMS", "99.9 %", "same", "label % b", "label % a", "truth b", "b/i (u)",
              "CPU");
  for (const int tiles : arguments.tiles) {
    job.tiles = tiles;
    TESSERA_ASSIGN_OR_RETURN(const SceneRunner::Result tiled, runner.Run(absl::StrCat("tiles_", tiles), job));
    const std::vector<CellRect> cores = CoresOf(tiled.tasks);
    const double band_m = arguments.band_gsd * survey.gsd_m;
    const std::vector<uint8_t> vertex_in_band = InBand(start.mesh.vertices, survey.ground, cores, band_m);
    const std::vector<uint8_t> face_in_band = InBand(centroids, survey.ground, cores, band_m);
    if (tiled.mesh.faces != untiled.mesh.faces) return absl::InternalError("the results differ in their faces");
    std::vector<double> band, all;
    for (size_t v = 0; v < tiled.mesh.vertices.size(); ++v) {
      all.push_back((tiled.mesh.vertices[v] - untiled.mesh.vertices[v]).norm() / survey.gsd_m);
      if (vertex_in_band[v]) band.push_back(all.back());
    }
    double area[2] = {0, 0}, other[2] = {0, 0};
    for (size_t f = 0; f < face_in_band.size(); ++f) {
      const double face_area = FaceArea(start.mesh, f);
      const bool differs = tiled.mesh.labels[f] != untiled.mesh.labels[f];
      for (const int k : {0, 1}) {
        if (k == 0 && !face_in_band[f]) continue;
        area[k] += face_area;
        other[k] += differs * face_area;
      }
    }
    TESSERA_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(absl::StrCat(arguments.out, "/tiles_", tiles, ".ply")));
    const bool same_bytes = bytes == untiled_bytes;
    const Spread b = SpreadOf(band), a = SpreadOf(all);
    std::printf("%5zu | %5s | %9.5f %9.4f %9.3f %7.4f | %9.5f %9.4f %7.4f | %9.4f %9.4f |", cores.size(),
                same_bytes ? "same" : "other", b.rms, b.p999, b.most, b.same, a.rms, a.p999, a.same,
                100 * other[0] / area[0], 100 * other[1] / area[1]);
    if (truth) {
      const auto distance = [&](const TriangleMesh& mesh, bool in_band) {
        return MeanTruthDistance(*truth, mesh.vertices, vertex_in_band, in_band);
      };
      const double of_band = distance(tiled.mesh, true), before = distance(untiled.mesh, true);
      // How much nearer to the truth the interior is than the band, beside the same of the untiled run.
      const double ratio = (of_band / distance(tiled.mesh, false)) / (before / distance(untiled.mesh, false));
      std::printf(" %7.4f %7.4f |", of_band / before, ratio);
    } else {
      std::printf(" %7s %7s |", "-", "-");
    }
    std::printf(" %7.3f\n", tiled.all_cpu_s() / untiled.all_cpu_s());
    std::fflush(stdout);
  }
  return absl::OkStatus();
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) {
  CLI::App app("Tiled against untiled: differences in the seam band, and cost");
  tessera::Arguments a;
  app.add_option("--scene", a.scene, "folder of a scene")->required();
  app.add_option("--out", a.out, "folder for the results")->required();
  app.add_option("--tiles", a.tiles)->delimiter(',')->allow_extra_args(false)->capture_default_str();
  app.add_option("--band", a.band_gsd, "GSD")->capture_default_str();
  app.add_option("--method", a.method)->capture_default_str();
  app.add_option("--settings", a.settings, "as JSON");
  app.add_option("--threads", a.threads, "0: one for each core");
  CLI11_PARSE(app, argc, argv);
  const tessera::Status status = tessera::Bench(a);
  if (status.ok()) return 0;
  std::fprintf(stderr, "seam_bench: %s\n", std::string(status.message()).c_str());
  return 1;
}
