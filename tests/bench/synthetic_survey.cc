#include "tests/bench/synthetic_survey.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>

#include "common/base/random.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

constexpr double kFacesPerCell = 1100;
constexpr int kRig = 5, kViewsPerDirection = 8, kPartners = 4;
constexpr double kFocalWidths = 1.2;  // focal length in widths of the image, as aerial rigs have (45 degrees)

// Looks along `forward` with the image's x axis along `right`.
PosedCamera CameraAt(const Vector3d& centre, const Vector3d& forward, const Vector3d& right, const SyntheticCity& city,
                     double height_m) {
  PosedCamera camera;
  const double f = height_m / city.gsd_m;
  camera.intrinsics = {city.image_width, city.image_height, f, f, 0.5 * city.image_width, 0.5 * city.image_height};
  camera.rotation_cam_from_world.row(0) = right.transpose();
  camera.rotation_cam_from_world.row(1) = forward.cross(right).transpose();
  camera.rotation_cam_from_world.row(2) = forward.transpose();
  camera.translation_cam_from_world = -camera.rotation_cam_from_world * centre;
  return camera;
}

}  // namespace

Survey MakeSyntheticSurvey(const SyntheticCity& city) {
  Random random(city.seed);
  Survey survey;
  survey.scene_name = "synthetic";
  survey.gsd_m = city.gsd_m;
  survey.ground.cell_m = std::exp2(std::round(std::log2(64 * city.gsd_m)));
  const double cell_m = survey.ground.cell_m;
  const int side = std::max(1, static_cast<int>(std::lround(std::sqrt(city.faces / kFacesPerCell))));
  const double side_m = side * cell_m, height_m = kFocalWidths * city.image_width * city.gsd_m;

  const int stations = std::max(1, city.images / kRig);
  const int rows = std::max(1, static_cast<int>(std::lround(std::sqrt(stations))));
  const int columns = (stations + rows - 1) / rows;
  constexpr double kSlant = 0.70710678118654752;
  const std::array<std::pair<Vector3d, Vector3d>, kRig> looks = {{{{0, 0, -1}, {1, 0, 0}},
                                                                  {{kSlant, 0, -kSlant}, {0, -1, 0}},
                                                                  {{-kSlant, 0, -kSlant}, {0, 1, 0}},
                                                                  {{0, kSlant, -kSlant}, {1, 0, 0}},
                                                                  {{0, -kSlant, -kSlant}, {-1, 0, 0}}}};
  // One camera of the rig after the other, so that views that are compared are near each other, as ingest has them.
  for (int k = 0; k < kRig; ++k) {
    for (int s = 0; s < stations; ++s) {
      const Vector3d centre(side_m * (s % columns + 0.5) / columns, side_m * (s / columns + 0.5) / rows, height_m);
      SceneView view;
      view.name = "flight_2026/strip_" + std::to_string(s / columns) + "/image_" + std::to_string(s) + "_" +
                  std::to_string(k) + ".jpg";
      view.image_path = "images/" + view.name;
      view.likelihood_path = "likelihoods/" + view.name.substr(0, view.name.size() - 4) + ".tif";
      view.camera = CameraAt(centre, looks[k].first, looks[k].second, city, height_m);
      view.lens.kind = LensModel::Kind::kOpenCv;
      view.lens.pinhole = view.camera.intrinsics;
      view.lens.coefficients[0] = 1e-3 * random.Uniform(-1, 1);
      survey.views.push_back(std::move(view));
    }
  }
  // The stations nearest to where a rig's camera must stand to have the place in its middle.
  const auto nearest = [&](const Eigen::Vector2d& p, int look, size_t count) {
    const Vector3d& forward = looks[look].first;
    const Eigen::Vector2d stand = p - forward.head<2>() / -forward.z() * height_m;
    const int c = static_cast<int>(std::floor(stand.x() / side_m * columns));
    const int r = static_cast<int>(std::floor(stand.y() / side_m * rows));
    std::vector<std::pair<double, int32_t>> found;
    for (int y = std::max(0, r - 2); y <= std::min(rows - 1, r + 2); ++y) {
      for (int x = std::max(0, c - 2); x <= std::min(columns - 1, c + 2); ++x) {
        const int station = y * columns + x;
        if (station >= stations) continue;
        const Eigen::Vector2d at(side_m * (x + 0.5) / columns, side_m * (y + 0.5) / rows);
        found.emplace_back((at - stand).norm(), look * stations + station);
      }
    }
    std::sort(found.begin(), found.end());
    if (found.size() > count) found.resize(count);
    return found;
  };

  double weights = 0;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      SurveyCell cell;
      cell.x = x;
      cell.y = y;
      const Eigen::Vector2d middle((x + 0.5) * cell_m, (y + 0.5) * cell_m);
      const double from_middle = (middle / side_m - Eigen::Vector2d(0.5, 0.5)).norm();
      const double weight = 1 + (city.dense_share - 1) * std::exp(-20 * from_middle * from_middle);
      weights += weight;
      cell.reach_m = 2 * city.gsd_m;
      cell.box_min = {x * cell_m, y * cell_m, 0};
      cell.box_max = {(x + 1) * cell_m, (y + 1) * cell_m, 5 + 10 * weight * random.Uniform()};
      cell.faces = static_cast<int64_t>(1e6 * weight);
      for (int look = 0; look < kRig; ++look) {
        for (const auto& [distance, view] : nearest(middle, look, kViewsPerDirection)) cell.views.push_back(view);
      }
      std::sort(cell.views.begin(), cell.views.end());
      survey.cells.push_back(std::move(cell));
    }
  }
  for (SurveyCell& cell : survey.cells) {
    cell.faces = std::max<int64_t>(1, std::llround(static_cast<double>(cell.faces) / (1e6 * weights) * city.faces));
    survey.faces += cell.faces;
  }
  const int count = static_cast<int>(survey.views.size());
  for (int v = 0; v < count; ++v) {
    for (int k = 1; k <= kPartners; ++k) {
      const int step = k % 2 ? (k + 1) / 2 : columns * k / 2;
      for (const int other : {v - step, v + step}) {
        if (other >= 0 && other < count && other / stations == v / stations) survey.pairs.push_back({v, other});
      }
    }
  }
  for (const char* name : {"ground", "facade", "roof", "vegetation"}) {
    SceneClass c;
    c.name = name;
    survey.classes.push_back(c);
  }
  survey.has_likelihoods = survey.has_labels = true;
  survey.vertices = survey.faces / 2;
  survey.input_faces = survey.faces / 10;
  survey.input_vertices = survey.faces / 20;
  FillViewDepths(&survey);
  return survey;
}

}  // namespace tessera
