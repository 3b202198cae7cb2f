// How many triangles a viewer draws of a 3D Tiles set: a model of the selection of 3d-tiles-renderer and CesiumJS with
// refine REPLACE. A tile outside of the frustum is not drawn. A tile whose geometric error, at the point of its box
// that is nearest to the camera, covers no more pixels than allowed is drawn; else its children are, or itself if it
// has none.
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "common/storage/files.h"

namespace tessera {

inline constexpr double kViewWidth_px = 1280, kViewHeight_px = 800, kViewError_px = 8;

struct ViewCamera {
  Eigen::Vector3d position, forward, right, up;
  double vertical_rad = 0;

  // `down_rad`: of the direction of view below the horizon. `vertical_rad`: the field of view.
  ViewCamera(const Eigen::Vector3d& at, double heading_rad, double down_rad, double fov_rad)
      : position(at), vertical_rad(fov_rad) {
    forward = {std::cos(heading_rad) * std::cos(down_rad), std::sin(heading_rad) * std::cos(down_rad),
               -std::sin(down_rad)};
    right = {std::sin(heading_rad), -std::cos(heading_rad), 0};
    up = right.cross(forward);
  }

  bool Sees(const Eigen::AlignedBox3d& box) const {
    const double tan_y = std::tan(vertical_rad / 2), tan_x = tan_y * kViewWidth_px / kViewHeight_px;
    const Eigen::Vector3d half = box.sizes() / 2, to = box.center() - position;
    for (const Eigen::Vector3d& normal :
         {Eigen::Vector3d(forward), Eigen::Vector3d(tan_x * forward + right), Eigen::Vector3d(tan_x * forward - right),
          Eigen::Vector3d(tan_y * forward + up), Eigen::Vector3d(tan_y * forward - up)}) {
      if (to.dot(normal) + half.dot(normal.cwiseAbs()) < 0) return false;
    }
    return true;
  }

  double Pixels(const Eigen::AlignedBox3d& box, double error_m) const {
    return error_m * kViewHeight_px / (std::max(1e-3, box.exteriorDistance(position)) * 2 * std::tan(vertical_rad / 2));
  }
};

// A tile with all below it.
struct ViewTile {
  Eigen::AlignedBox3d box;
  double error_m = 0, triangles = 0;
  std::vector<ViewTile> children;
};

// Triangles that are drawn of the tile, moved by `shift`, and below.
inline double TrianglesInView(const ViewTile& tile, const Eigen::Vector3d& shift, const ViewCamera& camera) {
  Eigen::AlignedBox3d box = tile.box;
  box.translate(shift);
  if (!camera.Sees(box)) return 0;
  if (tile.children.empty() || camera.Pixels(box, tile.error_m) <= kViewError_px) return tile.triangles;
  double sum = 0;
  for (const ViewTile& child : tile.children) sum += TrianglesInView(child, shift, camera);
  return sum;
}

// Calls view(camera) for many cameras over the rectangle, on its ground of height `ground_m`: 50 m to 10 km high;
// nadir, 45 and 75 degrees off it, and near the horizon; over corners where tiles meet, over their insides, from
// outside.
template <class View>
void ForEachCamera(const Eigen::AlignedBox2d& city, double ground_m, const View& view) {
  constexpr double kDegree = std::numbers::pi / 180;
  for (const double fov_rad : {0.691, 1.047}) {  // of CesiumJS at this size, and of 3d-tiles-renderer's examples
    for (double height_m = 50; height_m < 10001; height_m *= 1.3) {
      for (const auto& [x, y] : std::array<std::pair<double, double>, 6>{
               {{0.5, 0.5}, {0.53, 0.51}, {0.76, 0.74}, {0, 0.52}, {0.01, 0.01}, {-0.1, 0.4}}}) {
        const Eigen::Vector2d at = city.min() + Eigen::Vector2d(x, y).cwiseProduct(city.sizes());
        for (const double heading : {0.0, 0.4, 45 * kDegree}) {
          for (const double off_nadir : {0.0, 45.0, 60.0, 75.0, 85.0}) {
            view(ViewCamera({at.x(), at.y(), ground_m + height_m}, heading, (90 - off_nadir) * kDegree, fov_rad));
          }
        }
      }
    }
  }
}

// The camera with the most triangles.
struct LargestView {
  double triangles = -1;
  ViewCamera camera{{0, 0, 0}, 0, 0, 1};

  void Add(double count, const ViewCamera& of) {
    if (count <= triangles) return;
    triangles = count;
    camera = of;
  }
};

// Number of triangles of a GLB file, from its JSON.
inline double CountGlbTriangles(const std::string& bytes) {
  uint32_t json_bytes = 0;
  if (bytes.size() < 20) return 0;
  std::memcpy(&json_bytes, bytes.data() + 12, 4);
  const auto json = nlohmann::json::parse(bytes.substr(20, json_bytes));
  double triangles = 0;
  for (const auto& mesh : json["meshes"]) {
    for (const auto& primitive : mesh["primitives"]) {
      triangles += json["accessors"][primitive["indices"].get<size_t>()]["count"].get<double>() / 3;
    }
  }
  return triangles;
}

// `json`: a tile of a file in `folder`. Throws nlohmann's exceptions, and absl's for a missing file.
inline ViewTile ReadViewTile(const nlohmann::json& json, const std::string& folder) {
  const std::string path = folder + "/" + json["content"]["uri"].get<std::string>();
  const std::string bytes = ReadFile(path).value();
  if (path.ends_with(".json")) {
    return ReadViewTile(nlohmann::json::parse(bytes)["root"], path.substr(0, path.rfind('/')));
  }
  ViewTile tile;
  const auto& box = json["boundingVolume"]["box"];
  const Eigen::Vector3d centre(box[0], box[1], box[2]), half(box[3], box[7], box[11]);
  tile.box = {centre - half, centre + half};
  tile.error_m = json["geometricError"];
  tile.triangles = CountGlbTriangles(bytes);
  for (const auto& child : json.value("children", nlohmann::json::array())) {
    tile.children.push_back(ReadViewTile(child, folder));
  }
  return tile;
}

// All tiles of tileset.json in `folder`.
inline ViewTile ReadTileset(const std::string& folder) {
  return ReadViewTile(nlohmann::json::parse(ReadFile(folder + "/tileset.json").value())["root"], folder);
}

}  // namespace tessera
