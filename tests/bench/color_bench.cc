// What colours from photographs are worth: a refined mesh is coloured without some views, drawn into each of them, and
// compared with its photograph.
//   color_bench SCENE MESH [--every N]
// Prints, for every N-th view, the mean absolute error of red, green and blue (0 to 255) at the pixels that show
// coloured vertices: of the colours of ColorPoints, of those by each vertex's best view alone, and of those by the
// nearest camera alone; the ratios; and CPU microseconds per vertex.
#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <string>
#include <vector>

#include "common/exporting/color/point_colors.h"
#include "common/geometry/ray_caster.h"
#include "common/imaging/image_io.h"
#include "common/meshio/ply.h"
#include "common/scene/scene.h"

namespace tessera {
namespace {

struct ColoredMesh {
  std::vector<Rgb> colors;
  std::vector<uint8_t> seen;
};

struct Surface {
  TriangleMesh mesh;
  std::vector<Eigen::Vector3f> normals;
  std::vector<float> spacing_m;
};

Surface SurfaceOf(TriangleMesh mesh) {
  Surface surface;
  std::vector<Eigen::Vector3d> normals(mesh.vertices.size(), Eigen::Vector3d::Zero());
  std::vector<double> sums(normals.size()), counts(normals.size());
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const uint32_t v = mesh.faces[f][k];
      normals[v] += FaceCross(mesh, f);
      for (const int j : {1, 2}) sums[v] += (mesh.Corner(f, (k + j) % 3) - mesh.Corner(f, k)).norm();
      counts[v] += 2;
    }
  }
  for (size_t v = 0; v < normals.size(); ++v) {
    surface.normals.push_back(normals[v].stableNormalized().cast<float>());
    surface.spacing_m.push_back(static_cast<float>(sums[v] / std::max(1.0, counts[v])));
  }
  surface.mesh = std::move(mesh);
  return surface;
}

// Colours by the views of `used`.
StatusOr<ColoredMesh> ColorBy(const SceneDescription& scene, const Surface& surface, const std::vector<bool>& used,
                              int views_per_point) {
  const MeshSpans occluder = surface.mesh;
  std::vector<std::string> files, masks;
  for (size_t v = 0; v < scene.views.size(); ++v) {
    files.push_back(used[v] ? scene.folder + "/" + scene.views[v].image_path : "");
    masks.push_back(scene.views[v].mask_path.empty() ? "" : scene.folder + "/" + scene.views[v].mask_path);
  }
  PointColorInput input;
  input.points = surface.mesh.vertices;
  input.normals = surface.normals;
  input.spacing_m = surface.spacing_m;
  input.occluders = {&occluder, 1};
  input.views = scene.views;
  input.view_files = files;
  input.mask_files = masks;
  input.views_per_point = views_per_point;
  ColoredMesh colored;
  TESSERA_RETURN_IF_ERROR(ColorPoints(input, &colored.colors, &colored.seen, {}));
  return colored;
}

// The view with the nearest direction of view among those whose camera is not far more distant than the nearest.
size_t NearestView(const SceneDescription& scene, size_t of) {
  size_t nearest = of;
  double best = 1e30;
  for (size_t v = 0; v < scene.views.size(); ++v) {
    if (v == of) continue;
    const PosedCamera &a = scene.views[v].camera, &b = scene.views[of].camera;
    const double cosine = a.rotation_cam_from_world.row(2).dot(b.rotation_cam_from_world.row(2));
    const double distance = (a.Centre() - b.Centre()).norm() + 100 * std::acos(std::min(1.0, cosine));
    if (distance < best) best = distance, nearest = v;
  }
  return nearest;
}

struct Errors {
  double five = 0, other = 0;
  int64_t values = 0;
};

// Errors of two colourings at the pixels of view `v` that show vertices which both have coloured.
Errors Compare(const SceneDescription& scene, const Surface& surface, const RayCaster& caster, size_t v,
               const FloatImage& photograph, const ColoredMesh& five, const ColoredMesh& other) {
  Errors errors;
  const PosedCamera& camera = scene.views[v].camera;
  for (int y = 0; y < photograph.height; ++y) {
    for (int x = 0; x < photograph.width; ++x) {
      if (std::isnan(photograph.at(x, y))) continue;
      const RayHit hit = caster.Cast(camera.Centre(), camera.Ray(x + 0.5, y + 0.5));
      if (!hit.hit()) continue;
      const Triangle& face = surface.mesh.faces[hit.face];
      bool known = true;
      for (const uint32_t i : face) known = known && five.seen[i] > 0 && other.seen[i] > 0;
      if (!known) continue;
      const double weights[3] = {1 - hit.u - hit.v, hit.u, hit.v};
      for (int c = 0; c < 3; ++c) {
        double a = 0, b = 0;
        for (int k = 0; k < 3; ++k) {
          a += weights[k] * five.colors[face[k]][c];
          b += weights[k] * other.colors[face[k]][c];
        }
        errors.five += std::abs(a - 255 * photograph.at(x, y, c));
        errors.other += std::abs(b - 255 * photograph.at(x, y, c));
        ++errors.values;
      }
    }
  }
  return errors;
}

Status Bench(const std::string& scene_path, const std::string& mesh_path, int every) {
  TESSERA_ASSIGN_OR_RETURN(SceneDescription scene, LoadScene(scene_path, nullptr));
  TESSERA_ASSIGN_OR_RETURN(MeshContent content, ReadPly(mesh_path));
  for (Eigen::Vector3d& p : content.mesh.vertices) p = scene.frame.LocalFromScene(p);
  const Surface surface = SurfaceOf(std::move(content.mesh));
  const RayCaster caster(surface.mesh);
  double sums[4] = {};
  double cpu_s = 0;
  int colorings = 0;
  std::printf("%-12s %8s | %8s %8s %6s | %8s %8s %6s\n", "view", "Mpixels", "median", "best", "ratio", "median",
              "nearest", "ratio");
  for (size_t v = 0; v < scene.views.size(); v += static_cast<size_t>(every)) {
    std::vector<bool> used(scene.views.size(), true), nearest(scene.views.size(), false);
    used[v] = false;
    nearest[NearestView(scene, v)] = true;
    const std::clock_t start = std::clock();
    TESSERA_ASSIGN_OR_RETURN(const ColoredMesh five, ColorBy(scene, surface, used, 5));
    cpu_s += static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
    ++colorings;
    TESSERA_ASSIGN_OR_RETURN(const ColoredMesh best, ColorBy(scene, surface, used, 1));
    TESSERA_ASSIGN_OR_RETURN(const ColoredMesh near, ColorBy(scene, surface, nearest, 1));
    const LensModel& lens = scene.views[v].lens;
    TESSERA_ASSIGN_OR_RETURN(const FloatImage photograph,
                             ReadColorPart(scene.folder + "/" + scene.views[v].image_path, lens,
                                           {0, 0, lens.pinhole.width, lens.pinhole.height}, {}));
    const Errors a = Compare(scene, surface, caster, v, photograph, five, best);
    const Errors b = Compare(scene, surface, caster, v, photograph, five, near);
    const double values[4] = {a.five / static_cast<double>(a.values), a.other / static_cast<double>(a.values),
                              b.five / static_cast<double>(b.values), b.other / static_cast<double>(b.values)};
    for (int i = 0; i < 4; ++i) sums[i] += values[i];
    std::printf("%-12s %8.3f | %8.2f %8.2f %6.3f | %8.2f %8.2f %6.3f\n", scene.views[v].name.c_str(),
                1e-6 * static_cast<double>(a.values) / 3, values[0], values[1], values[0] / values[1], values[2],
                values[3], values[2] / values[3]);
  }
  std::printf("%-12s %8s | %8.2f %8.2f %6.3f | %8.2f %8.2f %6.3f\n", "mean", "", sums[0] / colorings,
              sums[1] / colorings, sums[0] / sums[1], sums[2] / colorings, sums[3] / colorings, sums[2] / sums[3]);
  std::printf("%zu vertices, %zu views: %.2f CPU microseconds per vertex\n", surface.mesh.vertices.size(),
              scene.views.size(), 1e6 * cpu_s / colorings / static_cast<double>(surface.mesh.vertices.size()));
  return absl::OkStatus();
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) {
  CLI::App app("Error of colours from photographs against views that are left out");
  std::string scene, mesh;
  int every = 5;
  app.add_option("SCENE", scene)->required();
  app.add_option("MESH", mesh, "a refined mesh, in coordinates of the scene")->required();
  app.add_option("--every", every)->check(CLI::PositiveNumber);
  CLI11_PARSE(app, argc, argv);
  const tessera::Status status = tessera::Bench(scene, mesh, every);
  if (!status.ok()) std::fprintf(stderr, "%s\n", status.ToString().c_str());
  return status.ok() ? 0 : 1;
}
