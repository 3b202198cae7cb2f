// What occluders cost, and what is lost by having fewer of them:
//   occluder_bench --scene DIR --tiles 9 --out DIR
// cuts the scene's tiles with all faces that may hide them, with those that do, and with those simplified. Prints faces
// and bytes in all packages, CPU seconds to cut them and to draw all their views once (refining does so in each
// iteration), and how the tile is seen: the share of its pixels that another variant shows or hides, and how far the
// farthest of them, in images of four times the resolution, is from where the visible part ends with all faces.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/scene/scene.h"
#include "common/storage/files.h"
#include "common/tile/task_parameters.h"
#include "server/plan/graph.h"
#include "worker/tasks/city_file.h"
#include "worker/tasks/cut_tile.h"
#include "worker/tasks/task.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

constexpr int kFiner = 4, kFinerEach = 8;  // drawing finer costs most: every so many views
constexpr int kFarthest_px = 4;            // is not looked for beyond
constexpr int kCoarse = 2;                 // pyramid level

double CpuSeconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

// The part of its image inside `rect` as an image of its own.
PosedCamera Cropped(PosedCamera camera, const PixelRect& rect) {
  PinholeCamera& k = camera.intrinsics;
  k.width = rect.width();
  k.height = rect.height();
  k.cx -= rect.x0;
  k.cy -= rect.y0;
  return camera;
}

PosedCamera Scaled(PosedCamera camera, double scale) {
  PinholeCamera& k = camera.intrinsics;
  k.width = static_cast<int>(std::ceil(k.width * scale));
  k.height = static_cast<int>(std::ceil(k.height * scale));
  for (double* value : {&k.fx, &k.fy, &k.cx, &k.cy}) *value *= scale;
  return camera;
}

struct Row {
  std::string name;
  OccluderOptions options;
  int64_t faces = 0, bytes = 0, seen_px = 0, other_px = 0, finer_other_px = 0;
  double cut_s = 0, draw_s = 0, coarse_draw_s = 0, farthest_px = 0;
};

double DrawSeconds(const TilePackage& package, const TriangleMesh* occluders, const std::vector<PosedCamera>& cameras,
                   double scale) {
  std::vector<CameraWindow> scaled;
  for (const PosedCamera& camera : cameras) scaled.emplace_back(Scaled(camera, scale));
  Rasterizer rasterizer;
  std::vector<FaceMap> maps;
  rasterizer.DrawViews(package.mesh, occluders, scaled, &maps);  // buffers are had
  const double start_s = CpuSeconds();
  rasterizer.DrawViews(package.mesh, occluders, scaled, &maps);
  return CpuSeconds() - start_s;
}

// Distance in pixels of `map` from pixel i to the next one that is seen if i is hidden, or hidden if it is seen.
double DistanceToOutline(const FaceMap& map, size_t i) {
  const int x = static_cast<int>(i % map.width), y = static_cast<int>(i / map.width), reach = kFiner * kFarthest_px;
  const bool seen = map.face[i] >= 0;
  double nearest = reach;
  for (int v = std::max(0, y - reach); v <= std::min(map.height - 1, y + reach); ++v) {
    for (int u = std::max(0, x - reach); u <= std::min(map.width - 1, x + reach); ++u) {
      if ((map.face[static_cast<size_t>(v) * map.width + u] >= 0) != seen) {
        nearest = std::min(nearest, std::hypot(u - x, v - y));
      }
    }
  }
  return nearest;
}

void Compare(const TilePackage& all, const TilePackage& package, const std::vector<PosedCamera>& cameras, Row* row) {
  for (size_t v = 0; v < cameras.size(); ++v) {
    const PosedCamera& camera = cameras[v];
    const FaceMap whole = RasterizeFaces(all.mesh, &all.occluders, camera);
    const FaceMap map = RasterizeFaces(all.mesh, &package.occluders, camera);
    for (size_t i = 0; i < map.face.size(); ++i) {
      row->seen_px += whole.face[i] >= 0;
      row->other_px += whole.face[i] != map.face[i];
    }
    if (v % kFinerEach != 0) continue;
    const PosedCamera finer = Scaled(camera, kFiner);
    const FaceMap fine_whole = RasterizeFaces(all.mesh, &all.occluders, finer);
    const FaceMap fine = RasterizeFaces(all.mesh, &package.occluders, finer);
    for (size_t i = 0; i < fine.face.size(); ++i) {
      if (fine_whole.face[i] == fine.face[i]) continue;
      ++row->finer_other_px;
      row->farthest_px = std::max(row->farthest_px, DistanceToOutline(fine_whole, i) / kFiner);
    }
  }
}

Status Bench(const std::string& folder, const std::string& out, const JobSettings& settings, double share_px) {
  Warnings warnings;
  TESSERA_ASSIGN_OR_RETURN(const SceneDescription scene, LoadScene(folder, &warnings));
  TESSERA_ASSIGN_OR_RETURN(const PlannedTask ingest, PlanIngest(settings, scene.files));
  TESSERA_RETURN_IF_ERROR(EnsureFolder(out));
  if (!fs::exists(fs::path(out) / kSurveyFile)) {
    TESSERA_ASSIGN_OR_RETURN(const TempFolder in, TempFolder::Create("", "occluder_bench-"));
    fs::create_directory_symlink(fs::absolute(scene.folder), fs::path(in.path()) / kSceneFolder);
    TESSERA_RETURN_IF_ERROR(RunTask({"ingest", ingest.parameters, in.path(), out}, TaskControl()).status());
  }
  TESSERA_ASSIGN_OR_RETURN(const std::string survey_json, ReadFile(absl::StrCat(out, "/", kSurveyFile)));
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(survey_json));
  TESSERA_ASSIGN_OR_RETURN(const CityReader city, CityReader::Open(absl::StrCat(out, "/", kCityFile)));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<PlannedTask> planned, PlanTiles(settings, survey_json, scene.files));

  std::vector<Row> rows = {{"all that may hide", {.only_seen = false, .share_px = 0}},
                           {"seen", {.share_px = 0}},
                           {"simplified", {.only_seen = false, .share_px = share_px}},
                           {"seen, simplified", {.share_px = share_px}}};
  int tiles = 0;
  int64_t tile_faces = 0;
  double bare_draw_s = 0, bare_coarse_draw_s = 0;
  for (const PlannedTask& task : planned) {
    if (task.kind != "cut") continue;
    TESSERA_ASSIGN_OR_RETURN(const CutParameters parameters, ParseCutParameters(task.parameters));
    TilePackage all;
    std::vector<PosedCamera> cameras;
    for (Row& row : rows) {
      const double start_s = CpuSeconds();
      TESSERA_ASSIGN_OR_RETURN(const TilePackage package, CutTile(city, survey, parameters, row.options));
      row.cut_s += CpuSeconds() - start_s;
      if (all.mesh.faces.empty()) {
        all = package;
        for (const SceneView& view : all.views) {
          const PixelRect rect = ProjectedBounds(all.mesh, view.camera, 32, 16);
          if (!rect.empty()) cameras.push_back(Cropped(view.camera, rect));
        }
        ++tiles;
        tile_faces += static_cast<int64_t>(all.mesh.faces.size());
        bare_draw_s += DrawSeconds(all, nullptr, cameras, 1);
        bare_coarse_draw_s += DrawSeconds(all, nullptr, cameras, std::ldexp(1, -kCoarse));
      }
      row.faces += static_cast<int64_t>(package.occluders.faces.size());
      row.bytes += static_cast<int64_t>(package.occluders.faces.size() * sizeof(Triangle) +
                                        package.occluders.vertices.size() * sizeof(Eigen::Vector3d));
      row.draw_s += DrawSeconds(package, &package.occluders, cameras, 1);
      row.coarse_draw_s += DrawSeconds(package, &package.occluders, cameras, std::ldexp(1, -kCoarse));
      Compare(all, package, cameras, &row);
    }
  }
  std::printf("%s: %d tiles, %lld faces in them; %.3f px\n", scene.folder.c_str(), tiles,
              static_cast<long long>(tile_faces), share_px);
  std::printf("%-18s|%10s|%8s|%8s|%8s|%8s|%12s|%12s|%12s\n", "occluders", "faces", "MB", "cut s", "draw s", "level 2",
              "other px", "at 4x, px", "farthest px");
  std::printf("%-18s|%10d|%8.1f|%8s|%8.3f|%8.3f|\n", "none", 0, 0.0, "", bare_draw_s, bare_coarse_draw_s);
  for (const Row& row : rows) {
    std::printf("%-18s|%10lld|%8.2f|%8.2f|%8.3f|%8.3f|%10.5f %%|%12lld|%12.2f\n", row.name.c_str(),
                static_cast<long long>(row.faces), 1e-6 * static_cast<double>(row.bytes), row.cut_s, row.draw_s,
                row.coarse_draw_s, 100.0 * static_cast<double>(row.other_px) / static_cast<double>(row.seen_px),
                static_cast<long long>(row.finer_other_px), row.farthest_px);
  }
  return absl::OkStatus();
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) {
  CLI::App app("What occluders cost, and what is lost by having fewer of them");
  std::string scene, out;
  tessera::JobSettings settings;
  settings.tiles = 9;
  double share_px = tessera::OccluderOptions().share_px;
  int threads = 0;
  app.add_option("--scene", scene, "folder of a scene")->required();
  app.add_option("--out", out, "folder for what ingest makes (kept and used again)")->required();
  app.add_option("--tiles", settings.tiles)->capture_default_str();
  app.add_option("--share", share_px, "tolerance of simplifying, pixels")->capture_default_str();
  app.add_option("--threads", threads, "0: one for each core");
  CLI11_PARSE(app, argc, argv);
  const tessera::ThreadLimit limit(threads);
  const tessera::Status status = tessera::Bench(scene, out, settings, share_px);
  if (!status.ok()) std::fprintf(stderr, "occluder_bench: %s\n", status.ToString().c_str());
  return status.ok() ? 0 : 1;
}
