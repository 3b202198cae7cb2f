// What colours from photographs are worth: a refined mesh is coloured without some views, drawn into each of them, and
// compared with its photograph.
//   color_bench SCENE MESH [--every N]
// Prints, for every N-th view, the mean absolute error of red, green and blue (0 to 255) of the colours of ColorPoints,
// that of the colours by each vertex's best view alone, and their ratio, at the pixels that show the mesh and at its
// vertices (without the error of interpolation); the same beside the view with the nearest direction alone; the counts
// in millions; and CPU microseconds per vertex.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <string>
#include <utility>
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

// The view whose direction is nearest to that of view `of`.
size_t NearestView(const SceneDescription& scene, size_t of) {
  const auto direction = [&](size_t v) { return scene.views[v].camera.rotation_cam_from_world.row(2); };
  size_t nearest = of == 0 ? 1 : 0;
  for (size_t v = 0; v < scene.views.size(); ++v) {
    if (v != of && direction(v).dot(direction(of)) > direction(nearest).dot(direction(of))) nearest = v;
  }
  return nearest;
}

// Sums of absolute errors of two colourings.
struct Errors {
  double median = 0, other = 0;
  int64_t values = 0;

  void Add(const Eigen::Vector3d& by_median, const Eigen::Vector3d& by_other, const Eigen::Vector3d& photograph) {
    median += (by_median - 255 * photograph).lpNorm<1>();
    other += (by_other - 255 * photograph).lpNorm<1>();
    values += 3;
  }
  void Print() const {
    const auto count = static_cast<double>(values);
    std::printf(" | %8.3f %7.2f %7.2f %6.3f", 1e-6 * count / 3, median / count, other / count, median / other);
  }
  Errors& operator+=(const Errors& b) {
    median += b.median;
    other += b.other;
    values += b.values;
    return *this;
  }
};

Eigen::Vector3d ColorAt(const FloatImage& image, double x, double y) {  // bilinear; NaN outside
  const int u = static_cast<int>(std::floor(x - 0.5)), v = static_cast<int>(std::floor(y - 0.5));
  Eigen::Vector3d color = Eigen::Vector3d::Constant(NAN);
  if (u < 0 || v < 0 || u + 1 >= image.width || v + 1 >= image.height) return color;
  const double a = x - 0.5 - u, b = y - 0.5 - v;
  for (int c = 0; c < 3; ++c) {
    color[c] = (1 - b) * ((1 - a) * image.at(u, v, c) + a * image.at(u + 1, v, c)) +
               b * ((1 - a) * image.at(u, v + 1, c) + a * image.at(u + 1, v + 1, c));
  }
  return color;
}

Eigen::Vector3d AsVector(const Rgb& color) { return {1.0 * color[0], 1.0 * color[1], 1.0 * color[2]}; }

// At the pixels of the view that show vertices which both have coloured.
Errors ComparePixels(const PosedCamera& camera, const Surface& surface, const RayCaster& caster,
                     const FloatImage& photograph, const ColoredMesh& by_median, const ColoredMesh& by_other) {
  Errors errors;
  for (int y = 0; y < photograph.height; ++y) {
    for (int x = 0; x < photograph.width; ++x) {
      const Eigen::Vector3d expected(photograph.at(x, y, 0), photograph.at(x, y, 1), photograph.at(x, y, 2));
      const RayHit hit = caster.Cast(camera.Centre(), camera.Ray(x + 0.5, y + 0.5));
      if (!expected.allFinite() || !hit.hit()) continue;
      const double weights[3] = {1 - hit.u - hit.v, hit.u, hit.v};
      Eigen::Vector3d a = Eigen::Vector3d::Zero(), b = a;
      bool is_known = true;
      for (int k = 0; k < 3; ++k) {
        const uint32_t v = surface.mesh.faces[hit.face][k];
        is_known = is_known && by_median.seen[v] > 0 && by_other.seen[v] > 0;
        a += weights[k] * AsVector(by_median.colors[v]);
        b += weights[k] * AsVector(by_other.colors[v]);
      }
      if (is_known) errors.Add(a, b, expected);
    }
  }
  return errors;
}

// At the vertices that the view sees.
Errors CompareVertices(const PosedCamera& camera, const Surface& surface, const RayCaster& caster,
                       const FloatImage& photograph, const ColoredMesh& by_median, const ColoredMesh& by_other) {
  Errors errors;
  for (size_t v = 0; v < surface.mesh.vertices.size(); ++v) {
    const Eigen::Vector3d& p = surface.mesh.vertices[v];
    const Eigen::Vector3d normal = surface.normals[v].cast<double>(), to_camera = camera.Centre() - p;
    const Eigen::Vector3d at = camera.Project(p);
    if (by_median.seen[v] == 0 || by_other.seen[v] == 0 || !camera.InImage(at)) continue;
    const double gsd_m = at.z() / camera.intrinsics.fx;
    if (normal.dot(to_camera.normalized()) < 0.17 || caster.Occluded(p + gsd_m * normal, camera.Centre(), gsd_m)) {
      continue;
    }
    const Eigen::Vector3d expected = ColorAt(photograph, at.x(), at.y());
    if (expected.allFinite()) errors.Add(AsVector(by_median.colors[v]), AsVector(by_other.colors[v]), expected);
  }
  return errors;
}

Status Bench(const std::string& scene_path, const std::string& mesh_path, int every) {
  TESSERA_ASSIGN_OR_RETURN(SceneDescription scene, LoadScene(scene_path, nullptr));
  TESSERA_ASSIGN_OR_RETURN(MeshContent content, ReadPly(mesh_path));
  for (Eigen::Vector3d& p : content.mesh.vertices) p = scene.frame.LocalFromScene(p);
  const Surface surface = SurfaceOf(std::move(content.mesh));
  const RayCaster caster(surface.mesh);
  double cpu_s = 0;
  int colorings = 0;
  std::printf("%-10s | %33s | %33s | %33s\n", "", "pixels: median, best, ratio", "vertices: median, best, ratio",
              "pixels: median, nearest, ratio");
  Errors sums[3];
  for (size_t v = 0; v < scene.views.size(); v += static_cast<size_t>(every)) {
    std::vector<bool> used(scene.views.size(), true), nearest(scene.views.size(), false);
    used[v] = false;
    nearest[NearestView(scene, v)] = true;
    const std::clock_t start = std::clock();
    TESSERA_ASSIGN_OR_RETURN(const ColoredMesh by_median, ColorBy(scene, surface, used, 5));
    cpu_s += static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
    ++colorings;
    TESSERA_ASSIGN_OR_RETURN(const ColoredMesh by_best, ColorBy(scene, surface, used, 1));
    TESSERA_ASSIGN_OR_RETURN(const ColoredMesh by_nearest, ColorBy(scene, surface, nearest, 1));
    const LensModel& lens = scene.views[v].lens;
    TESSERA_ASSIGN_OR_RETURN(const FloatImage photograph,
                             ReadColorPart(scene.folder + "/" + scene.views[v].image_path, lens,
                                           {0, 0, lens.pinhole.width, lens.pinhole.height}));
    const PosedCamera& camera = scene.views[v].camera;
    const Errors errors[3] = {ComparePixels(camera, surface, caster, photograph, by_median, by_best),
                              CompareVertices(camera, surface, caster, photograph, by_median, by_best),
                              ComparePixels(camera, surface, caster, photograph, by_median, by_nearest)};
    std::printf("%-10s", scene.views[v].name.c_str());
    for (int i = 0; i < 3; ++i) {
      errors[i].Print();
      sums[i] += errors[i];
    }
    std::printf("\n");
  }
  std::printf("%-10s", "all");
  for (const Errors& sum : sums) sum.Print();
  std::printf("\n");
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
