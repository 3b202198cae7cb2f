// What drawing a mesh costs: a city-like terrain seen from an oblique camera, at several sizes of a face in the image.
//   raster_bench [CELLS_A_SIDE]
// Prints CPU nanoseconds a face and view, and faces a second, on 1 and 2 threads. CPU time of all threads: it hardly
// changes with the load of the machine, and from 1 to 2 threads it would stay the same if sharing the work cost
// nothing.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <numbers>
#include <utility>
#include <vector>

#include "common/base/parallel.h"
#include "common/base/random.h"
#include "tests/support/draw_views.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

constexpr double kCell_m = 0.3;

// Rows of houses with upright walls, of `cells` x `cells` squares of one size cut into two faces each.
TriangleMesh MakeCity(int cells) {
  constexpr int kStreet = 20, kWall = 16, kRoof = 16, kPeriod = kStreet + kRoof + 2 * kWall;
  Random random(7);
  std::vector<std::pair<double, double>> profile{{0, 0}};  // across the rows: x and height
  for (int i = 0; i < cells; ++i) {
    auto [x, z] = profile.back();
    const int phase = i % kPeriod;
    const bool up = phase >= kStreet && phase < kStreet + kWall, down = phase >= kStreet + kWall + kRoof;
    (up || down ? z : x) += down ? -kCell_m : kCell_m;
    profile.emplace_back(x, z);
  }
  const double middle_m = 0.5 * profile.back().first;
  const auto jitter = [&] { return 0.3 * kCell_m * (random.Uniform() - 0.5); };
  TriangleMesh mesh;
  for (int y = 0; y <= cells; ++y) {
    for (const auto& [x, z] : profile) {
      mesh.vertices.push_back({x - middle_m + jitter(), kCell_m * (y - 0.5 * cells) + jitter(), z + 0.3 * jitter()});
    }
  }
  const auto id = [&](int x, int y) { return static_cast<uint32_t>(y * (cells + 1) + x); };
  for (int y = 0; y < cells; ++y) {
    for (int x = 0; x < cells; ++x) {
      mesh.faces.push_back({id(x, y), id(x + 1, y), id(x + 1, y + 1)});
      mesh.faces.push_back({id(x, y), id(x + 1, y + 1), id(x, y + 1)});
    }
  }
  return mesh;
}

// Cameras around the city, 30 degrees off the vertical, that see a face of the ground at about `face_px2`.
std::vector<CameraWindow> MakeCameras(int cells, double face_px2, int count) {
  const double side_m = kCell_m * cells, range_m = 2.5 * side_m;
  const double pixel_m = std::sqrt(0.5 * kCell_m * kCell_m / face_px2);
  std::vector<CameraWindow> cameras;
  for (int i = 0; i < count; ++i) {
    const double turn = 2 * std::numbers::pi * i / count, tilt = std::numbers::pi / 6;
    PosedCamera camera;
    PinholeCamera& k = camera.intrinsics;
    k.width = static_cast<int>(0.7 * side_m / pixel_m);
    k.height = static_cast<int>(side_m / pixel_m);
    k.fx = k.fy = range_m / pixel_m;
    k.cx = 0.5 * k.width;
    k.cy = 0.5 * k.height;
    const Vector3d forward(std::sin(tilt) * std::cos(turn), std::sin(tilt) * std::sin(turn), -std::cos(tilt));
    const Vector3d right = forward.cross(Vector3d::UnitZ()).normalized();
    camera.rotation_cam_from_world.row(0) = right;
    camera.rotation_cam_from_world.row(1) = forward.cross(right);
    camera.rotation_cam_from_world.row(2) = forward;
    camera.translation_cam_from_world = camera.rotation_cam_from_world * (range_m * forward);
    cameras.push_back(camera);
  }
  return cameras;
}

// CPU nanoseconds of the fastest of some calls.
template <typename Body>
double Nanoseconds(int calls, const Body& body) {
  double best = 1e30;
  for (int i = 0; i < calls; ++i) {
    const std::clock_t start = std::clock();
    body();
    best = std::min(best, 1e9 * static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC);
  }
  return best;
}

void Bench(int cells) {
  constexpr int kViews = 8, kCalls = 3;
  const TriangleMesh mesh = MakeCity(cells);
  const double faces = static_cast<double>(mesh.faces.size());
  std::printf("%zu faces, %d views\n", mesh.faces.size(), kViews);
  std::printf("%8s %12s %8s | %9s %12s | %15s\n", "px2/face", "pixels", "threads", "ns/face", "M faces/s",
              "one view, ns/face");
  for (double face_px2 : {0.25, 1.0, 4.0, 16.0}) {
    const std::vector<CameraWindow> cameras = MakeCameras(cells, face_px2, kViews);
    const PinholeCamera& k = cameras[0].camera.intrinsics;
    for (int threads : {1, 2}) {
      const ThreadLimit limit(threads);
      Rasterizer rasterizer;
      std::vector<FaceMap> maps;
      DrawViews(mesh, CellBoxes(mesh), cameras, &rasterizer, &maps);
      DrawViews(mesh, CellBoxes(mesh), {&cameras[0], 1}, &rasterizer, &maps);
      const double views_ns =
          Nanoseconds(kCalls, [&] { DrawViews(mesh, CellBoxes(mesh), cameras, &rasterizer, &maps); });
      const double one_ns = Nanoseconds(kCalls, [&] {
        DrawViews(mesh, CellBoxes(mesh), {&cameras[0], 1}, &rasterizer, &maps);
      });
      const double a_face = views_ns / faces / kViews;
      std::printf("%8.2f %12d %8d | %9.2f %12.1f | %15.2f\n", face_px2, k.width * k.height, threads, a_face,
                  1e3 / a_face, one_ns / faces);
    }
  }
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) {
  tessera::Bench(argc > 1 ? std::max(8, std::atoi(argv[1])) : 460);
  return 0;
}
