// How well changes between two flights are found and what that costs:
//   tessera synth town --seed 21 && tessera synth town-later --change town --seed 22
//   change_bench town town-later [--mesh town-out/mesh.ply] [--out DIR]
// The old surface is the base scene's truth, or the given mesh: what a job made of the base scene. Against
// truth/changes.geojson of the new scene a true change of 25 m2 and more is found if half of it is covered by reported
// areas; a reported area is right if half of it lies within 1 m of a true change, however small.
#include <CLI/CLI.hpp>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/base/task_usage.h"
#include "common/imaging/image_io.h"
#include "common/job/ground.h"
#include "common/meshio/mesh_format.h"
#include "common/render/coloring.h"
#include "common/scene/scene.h"
#include "common/storage/files.h"
#include "worker/changes/change_areas.h"
#include "worker/changes/change_report.h"
#include "worker/changes/disagreement.h"
#include "worker/changes/measure_changes.h"
#include "worker/changes/surface_raster.h"

namespace tessera {
namespace {

struct Arguments {
  std::string base, later, mesh, refined, out = "changes";
  MeasureOptions measure;
  ChangeAreaOptions areas;
  int threads = 0;
  double gsd_m = 0;
  bool rasters = false;
};

constexpr double kSample_m = 0.2;

struct Shape {
  std::string kind;
  double area_m2 = 0, height_difference_m = 0;
  std::vector<Ring> rings;                     // by the even-odd rule
  double agreement = 0, agreement_before = 0;  // of those reported
};

bool Inside(const Shape& shape, const Eigen::Vector2d& p) {
  bool inside = false;
  for (const Ring& ring : shape.rings) {
    for (size_t i = 0, j = ring.size() - 1; i < ring.size(); j = i++) {
      const Eigen::Vector2d &a = ring[i], &b = ring[j];
      if ((a.y() > p.y()) != (b.y() > p.y()) && p.x() < (b.x() - a.x()) * (p.y() - a.y()) / (b.y() - a.y()) + a.x()) {
        inside = !inside;
      }
    }
  }
  return inside;
}

double Distance(const Shape& shape, const Eigen::Vector2d& p) {
  if (Inside(shape, p)) return 0;
  double least = 1e30;
  for (const Ring& ring : shape.rings) {
    for (size_t i = 0, j = ring.size() - 1; i < ring.size(); j = i++) {
      const Eigen::Vector2d way = ring[j] - ring[i];
      const double length = way.squaredNorm();
      const double share = length > 0 ? std::clamp((p - ring[i]).dot(way) / length, 0.0, 1.0) : 0.0;
      least = std::min(least, (p - ring[i] - share * way).norm());
    }
  }
  return least;
}

// Share of `shape` that lies within `reach_m` of any of `others`.
double Covered(const Shape& shape, const std::vector<Shape>& others, double reach_m) {
  Eigen::AlignedBox2d box;
  for (const Eigen::Vector2d& p : shape.rings.front()) box.extend(p);
  int all = 0, covered = 0;
  for (double y = box.min().y() + 0.5 * kSample_m; y < box.max().y(); y += kSample_m) {
    for (double x = box.min().x() + 0.5 * kSample_m; x < box.max().x(); x += kSample_m) {
      const Eigen::Vector2d p(x, y);
      if (!Inside(shape, p)) continue;
      ++all;
      covered += std::any_of(others.begin(), others.end(), [&](const Shape& s) { return Distance(s, p) <= reach_m; });
    }
  }
  return all > 0 ? static_cast<double>(covered) / all : 0;
}

StatusOr<std::vector<Shape>> ReadShapes(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const std::string text, ReadFile(path));
  const auto json = nlohmann::json::parse(text, nullptr, false);
  if (json.is_discarded()) return absl::InvalidArgumentError(path + ": no JSON");
  std::vector<Shape> shapes;
  for (const auto& feature : json["features"]) {
    const auto& properties = feature["properties"];
    Shape shape{properties["kind"], properties["area_m2"], properties["height_difference_m"], {}, 0, 0};
    for (const auto& ring : feature["geometry"]["coordinates"]) {
      Ring points;
      for (const auto& p : ring) points.emplace_back(p[0], p[1]);
      points.pop_back();
      shape.rings.push_back(std::move(points));
    }
    shapes.push_back(std::move(shape));
  }
  return shapes;
}

// The new flight's scene, which has no mesh of its own, with the old surface in its place; `links` is its folder.
StatusOr<SceneDescription> LoadLater(const Arguments& arguments, const std::string& old_mesh,
                                     const std::string& links) {
  namespace fs = std::filesystem;
  for (const auto& entry : fs::directory_iterator(arguments.later)) {
    if (entry.path().filename() == "mesh.ply") continue;
    fs::create_symlink(fs::absolute(entry.path()), fs::path(links) / entry.path().filename());
  }
  fs::create_symlink(fs::absolute(old_mesh), fs::path(links) / "mesh.ply");
  Warnings warnings;
  return LoadScene(links, &warnings);
}

StatusOr<TriangleMesh> LoadMesh(const std::string& path, const SceneDescription& scene) {
  TESSERA_ASSIGN_OR_RETURN(MeshContent content, ReadMesh(path));
  for (Eigen::Vector3d& p : content.mesh.vertices) p = scene.frame.LocalFromScene(p);
  return std::move(content.mesh);
}

StatusOr<ChangeView> LoadView(const SceneDescription& scene, const SceneView& view) {
  ChangeView loaded;
  loaded.camera = view.camera;
  TESSERA_ASSIGN_OR_RETURN(loaded.luminance, ReadLuminance(scene.folder + "/" + view.image_path, view.lens));
  if (view.likelihood_path.empty()) return loaded;
  TESSERA_ASSIGN_OR_RETURN(loaded.likelihoods, ReadLikelihoods(scene.folder + "/" + view.likelihood_path,
                                                               static_cast<int>(scene.classes.size()), view.lens));
  loaded.likelihood_at = {static_cast<double>(loaded.likelihoods.width) / loaded.luminance.width,
                          static_cast<double>(loaded.likelihoods.height) / loaded.luminance.height,
                          0,
                          0,
                          0,
                          0};
  return loaded;
}

CellRect CellsOf(const TriangleMesh& mesh, const GroundPlane& ground) {
  CellRect rect{1 << 30, 1 << 30, -(1 << 30), -(1 << 30)};
  for (const Eigen::Vector3d& p : mesh.vertices) {
    const Eigen::Vector2i c = ground.Cell(p);
    rect = {std::min(rect.x0, c.x()), std::min(rect.y0, c.y()), std::max(rect.x1, c.x() + 1),
            std::max(rect.y1, c.y() + 1)};
  }
  return rect;
}

double CpuSeconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

// The raster's planes as pictures, for tuning.
Status WriteRasters(const ChangeRaster& raster, const std::string& folder) {
  const int width = raster.before.width(), height = raster.before.height(), zoom = std::max(1, 700 / width);
  const auto write = [&](const std::string& name, const auto& color) {
    ByteImage image(width * zoom, height * zoom, 3);
    for (int y = 0; y < image.height; ++y) {
      for (int x = 0; x < image.width; ++x) {
        const Color c = color(static_cast<size_t>(height - 1 - y / zoom) * width + x / zoom);
        for (int k = 0; k < 3; ++k) image.at(x, y, k) = static_cast<uint8_t>(255 * std::clamp(c[k], 0.0f, 1.0f));
      }
    }
    return WritePng(folder + "/" + name + ".png", image);
  };
  const auto grey = [](float value) {
    return std::isnan(value) ? Color(1, 0.8f, 0.8f) : Color(Color::Constant(value));
  };
  float low = 1e30f;
  for (const float h : raster.before.height_m) low = std::isnan(h) ? low : std::min(low, h);
  const Color palette[] = {{0.6f, 0.6f, 0.6f}, {0.8f, 0.3f, 0.2f}, {0.9f, 0.75f, 0.1f}, {0.2f, 0.6f, 0.2f}};
  const auto label = [&](uint8_t l) { return l < 4 ? palette[l] : Color(1, 1, 1); };
  TESSERA_RETURN_IF_ERROR(write("before", [&](size_t i) { return grey((raster.before.height_m[i] - low) / 30); }));
  TESSERA_RETURN_IF_ERROR(write("after", [&](size_t i) { return grey((raster.after.height_m[i] - low) / 30); }));
  TESSERA_RETURN_IF_ERROR(write("score", [&](size_t i) { return grey(raster.after_score[i]); }));
  TESSERA_RETURN_IF_ERROR(write("score_before", [&](size_t i) { return grey(raster.before_score[i]); }));
  TESSERA_RETURN_IF_ERROR(write("label_before", [&](size_t i) { return label(raster.before.label[i]); }));
  TESSERA_RETURN_IF_ERROR(write("label_after", [&](size_t i) { return label(raster.after.label[i]); }));
  return write("difference", [&](size_t i) {
    const float d = raster.after.height_m[i] - raster.before.height_m[i];
    return std::isnan(d) ? Color(0.7f, 0.7f, 0.5f) : DivergingColor(d / 6);
  });
}

// How far the new heights lie from `truth`, of cells known in both.
void PrintHeights(const ChangeRaster& raster, const SurfaceRaster& truth, double threshold_m) {
  std::vector<double> errors;
  int far = 0;
  for (size_t i = 0; i < truth.size(); ++i) {
    const double error = std::abs(raster.after.height_m[i] - truth.height_m[i]);
    if (std::isnan(error)) continue;
    errors.push_back(error);
    far += error > threshold_m;
  }
  if (errors.empty()) return;
  std::sort(errors.begin(), errors.end());
  std::printf("heights: median error %.3f m, 90 %% %.3f m, beyond %.2f m %.2f %% of %zu cells\n",
              errors[errors.size() / 2], errors[errors.size() * 9 / 10], threshold_m,
              100.0 * far / static_cast<double>(errors.size()), errors.size());
}

Status PrintScores(const std::vector<Shape>& truth, const std::vector<Shape>& reported, double min_area_m2) {
  std::map<std::string, std::array<int, 4>> kinds;  // true, found, reported, right
  std::printf("%-11s %8s %8s %8s  %s\n", "true", "m2", "height", "covered", "at");
  for (const Shape& shape : truth) {
    const double covered = Covered(shape, reported, 0);
    const bool counts = shape.area_m2 >= min_area_m2;
    std::printf("%-11s %8.1f %8.2f %8.2f  %.1f %.1f%s\n", shape.kind.c_str(), shape.area_m2, shape.height_difference_m,
                covered, shape.rings[0][0].x(), shape.rings[0][0].y(),
                counts ? covered < 0.5 ? " MISSED" : "" : " small");
    if (!counts) continue;
    ++kinds[shape.kind][0];
    kinds[shape.kind][1] += covered >= 0.5;
  }
  std::printf("%-11s %8s %8s %8s %8s %8s  %s\n", "reported", "m2", "height", "right", "agree", "old", "at");
  for (const Shape& shape : reported) {
    const double right = Covered(shape, truth, 1);
    std::printf("%-11s %8.1f %8.2f %8.2f %8.2f %8.2f  %.1f %.1f%s\n", shape.kind.c_str(), shape.area_m2,
                shape.height_difference_m, right, shape.agreement, shape.agreement_before, shape.rings[0][0].x(),
                shape.rings[0][0].y(), right < 0.5 ? " WRONG" : "");
    ++kinds[shape.kind][2];
    kinds[shape.kind][3] += right >= 0.5;
  }
  std::array<int, 4> all{};
  for (const auto& [kind, counts] : kinds) {
    std::printf("%-11s found %d of %d, right %d of %d\n", kind.c_str(), counts[1], counts[0], counts[3], counts[2]);
    for (size_t k = 0; k < all.size(); ++k) all[k] += counts[k];
  }
  std::printf("recall %.3f (%d of %d), precision %.3f (%d of %d)\n", all[0] > 0 ? 1.0 * all[1] / all[0] : 1, all[1],
              all[0], all[2] > 0 ? 1.0 * all[3] / all[2] : 1, all[3], all[2]);
  return absl::OkStatus();
}

Status Bench(const Arguments& arguments) {
  const ThreadLimit limit(arguments.threads);
  const std::string path = arguments.mesh.empty() ? arguments.base + "/truth/mesh.ply" : arguments.mesh;
  TESSERA_ASSIGN_OR_RETURN(const TempFolder links, TempFolder::Create(""));
  TESSERA_ASSIGN_OR_RETURN(const SceneDescription scene, LoadLater(arguments, path, links.path()));
  TESSERA_ASSIGN_OR_RETURN(const TriangleMesh mesh, LoadMesh(path, scene));
  double gsd_m = arguments.gsd_m;
  if (gsd_m == 0) {
    TESSERA_ASSIGN_OR_RETURN(gsd_m, MedianGsd(scene, mesh));
  }
  const GroundPlane ground = MakeGroundPlane(scene.up_in_local, ChangeCellSize_m(gsd_m));
  const CellRect cells = CellsOf(mesh, ground);
  const int classes = scene.has_likelihoods ? static_cast<int>(scene.classes.size()) : 0;
  std::vector<PosedCamera> cameras;
  double all_pixels = 0;
  for (const SceneView& view : scene.views) {
    cameras.push_back(view.camera);
    all_pixels += 1.0 * view.camera.intrinsics.width * view.camera.intrinsics.height;
  }
  double start_s = CpuSeconds();
  const std::vector<int> needed = ViewsToMeasure(mesh, ground, cells, cameras, gsd_m, arguments.measure);
  const double choose_s = CpuSeconds() - start_s;
  std::vector<ChangeView> views;
  for (const int v : needed) {
    TESSERA_ASSIGN_OR_RETURN(ChangeView view, LoadView(scene, scene.views[v]));
    views.push_back(std::move(view));
  }
  const TaskUsageMeter meter;
  start_s = CpuSeconds();
  const ChangeRaster raster = MeasureChanges(mesh, ground, cells, views, classes, gsd_m, arguments.measure);
  const double measure_s = CpuSeconds() - start_s, peak_mb = 1e-6 * static_cast<double>(meter.Read().peak_bytes);
  std::vector<SurfaceRaster> refined;
  if (!arguments.refined.empty()) {
    TESSERA_ASSIGN_OR_RETURN(const TriangleMesh newer, LoadMesh(arguments.refined, scene));
    refined.push_back(DrawSurface(TopSurface(newer, ground), ground, cells));
  }
  start_s = CpuSeconds();
  const std::vector<ChangeArea> areas =
      FindChangeAreas({&raster, 1}, refined, ClassRoles(scene.classes), gsd_m, arguments.areas);
  const double find_s = CpuSeconds() - start_s;
  const EpochDisagreement disagreement =
      MeasureDisagreement(raster, refined, ClassRoles(scene.classes), gsd_m, arguments.areas);
  TESSERA_RETURN_IF_ERROR(WriteChangeReport({scene, ground, raster, areas, gsd_m, disagreement}, arguments.out));
  if (arguments.rasters) TESSERA_RETURN_IF_ERROR(WriteRasters(raster, arguments.out));

  const double ground_m2 = ground.cell_m * ground.cell_m * static_cast<double>(raster.before.size());
  std::printf("%s: GSD %.3f m, cells of %.3f m, %d x %d; %zu of %zu views\n", arguments.later.c_str(), gsd_m,
              ground.cell_m, raster.before.width(), raster.before.height(), views.size(), scene.views.size());
  std::printf(
      "core seconds: choosing views %.2f, measuring %.2f (%.3f a megapixel of all views, %.3f of those read, "
      "%.3f per 1,000 m2), areas %.3f; peak %.0f MB above what was held\n",
      choose_s, measure_s, 1e6 * measure_s / all_pixels,
      1e6 * measure_s / std::max(1.0, 1.0 * all_pixels / scene.views.size() * views.size()),
      1000 * measure_s / ground_m2, find_s, peak_mb);
  std::printf("disagreement: ZNCC %.3f on the old surface, %.3f on the new; heights %.2f %%, labels %.2f %%\n",
              disagreement.agreement_before, disagreement.agreement, 100 * disagreement.before.heights,
              100 * disagreement.before.labels);
  const std::string newer_truth = arguments.later + "/truth/mesh.ply";
  if (FileExists(newer_truth)) {
    TESSERA_ASSIGN_OR_RETURN(const TriangleMesh newer, LoadMesh(newer_truth, scene));
    PrintHeights(raster, DrawSurface(TopSurface(newer, ground), ground, cells),
                 std::max(arguments.areas.height_m, arguments.areas.height_gsd * gsd_m));
  }
  std::vector<Shape> reported;
  for (const ChangeArea& area : areas) {
    Shape shape{ChangeKindName(area.kind), area.area_m2,   area.height_difference_m,
                {area.outline.outer},      area.agreement, area.agreement_before};
    shape.rings.insert(shape.rings.end(), area.outline.holes.begin(), area.outline.holes.end());
    for (Ring& ring : shape.rings) {
      for (Eigen::Vector2d& p : ring) {
        const Eigen::Vector3d local = ground.axis_x * p.x() + ground.axis_y * p.y();
        p = scene.frame.SceneFromLocal(local).head<2>();
      }
    }
    reported.push_back(std::move(shape));
  }
  std::vector<Shape> truth;
  const std::string truth_path = arguments.later + "/truth/changes.geojson";
  if (FileExists(truth_path)) {
    TESSERA_ASSIGN_OR_RETURN(truth, ReadShapes(truth_path));
  }
  return PrintScores(truth, reported, arguments.areas.min_area_m2);
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) {
  CLI::App app("Changes between two flights: recall, precision, cost");
  tessera::Arguments a;
  app.add_option("base", a.base, "folder of the base scene")->required();
  app.add_option("later", a.later, "folder of the new flight's scene")->required();
  app.add_option("--mesh", a.mesh, "old surface in the scene's coordinates; else the base scene's truth");
  app.add_option("--refined", a.refined, "mesh refined with the new flight: does it follow the changes?");
  app.add_option("--out", a.out)->capture_default_str();
  app.add_option("--gsd", a.gsd_m, "0: the median of the new views on the old surface");
  app.add_option("--threads", a.threads, "0: one for each core");
  app.add_flag("--rasters", a.rasters, "pictures of all that was measured too");
  app.add_option("--semantic", a.measure.semantic_weight)->capture_default_str();
  app.add_option("--old-bonus", a.measure.old_bonus)->capture_default_str();
  app.add_option("--step-px", a.measure.step_px)->capture_default_str();
  app.add_option("--views", a.measure.views.views_per_place)->capture_default_str();
  app.add_option("--pairs", a.measure.views.pairs_per_place)->capture_default_str();
  app.add_option("--p1", a.measure.penalties.one_level)->capture_default_str();
  app.add_option("--p2", a.measure.penalties.more)->capture_default_str();
  app.add_option("--p2-edge", a.measure.penalties.at_edge)->capture_default_str();
  app.add_option("--label-margin", a.areas.label_margin)->capture_default_str();
  app.add_option("--label-area", a.areas.min_label_area_m2)->capture_default_str();
  app.add_option("--min-width", a.areas.min_width_m)->capture_default_str();
  app.add_option("--min-agreement", a.areas.min_agreement)->capture_default_str();
  app.add_option("--min-gain", a.areas.min_agreement_gain)->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  const tessera::Status status = tessera::Bench(a);
  if (!status.ok()) std::fprintf(stderr, "change_bench: %s\n", status.ToString().c_str());
  return status.ok() ? 0 : 1;
}
