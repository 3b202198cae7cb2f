#include "common/exporting/color/color_sheet.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <iterator>
#include <limits>
#include <span>
#include <utility>

#include "common/exporting/color/point_colors.h"
#include "common/exporting/color/vertex_colors.h"
#include "common/exporting/sheet_border.h"
#include "common/geometry/position_index.h"

namespace tessera {
namespace {

// Sums of area times normal, and the mean edge length, at the vertices of the sheet.
struct VertexShapes {
  std::vector<Eigen::Vector3d> normals;
  std::vector<double> edge_sums;
  std::vector<uint32_t> edge_counts;

  void Add(const MeshSpans& mesh, size_t face, int corner, uint32_t vertex) {
    normals[vertex] += FaceCross(mesh, face);
    for (const int k : {1, 2}) {
      edge_sums[vertex] += (mesh.Corner(face, (corner + k) % 3) - mesh.Corner(face, corner)).norm();
      ++edge_counts[vertex];
    }
  }
};

VertexShapes ShapesOf(const SheetInput& input) {
  const Sheet& sheet = input.sheet;
  const size_t count = sheet.vertices.size();
  VertexShapes shapes = {std::vector<Eigen::Vector3d>(count, Eigen::Vector3d::Zero()), std::vector<double>(count),
                         std::vector<uint32_t>(count)};
  for (size_t f = 0; f < sheet.faces.size(); ++f) {
    for (int k = 0; k < 3; ++k) shapes.Add(sheet.mesh(), f, k, sheet.faces[f][k]);
  }
  // The vertices on the border have the lowest numbers of the index.
  PositionIndex index;
  std::vector<uint32_t> border;
  Eigen::AlignedBox3d box;
  const std::vector<uint8_t> is_border = BorderVertices(count, sheet.faces);
  for (uint32_t v = 0; v < count; ++v) {
    if (is_border[v] == 0) continue;
    if (index.NumberOf(sheet.vertices[v]) == border.size()) border.push_back(v);
    box.extend(sheet.vertices[v]);
  }
  for (const Sheet& neighbour : input.neighbours) {
    const MeshSpans mesh = neighbour.mesh();
    for (size_t f = 0; f < mesh.faces.size(); ++f) {
      for (int k = 0; k < 3; ++k) {
        if (!box.contains(mesh.Corner(f, k))) continue;
        const uint32_t number = index.NumberOf(mesh.Corner(f, k));
        if (number < border.size()) shapes.Add(mesh, f, k, border[number]);
      }
    }
  }
  return shapes;
}

// Points of the local frame as (ground x, ground y, height).
std::vector<Eigen::Vector3d> UprightPoints(const ExportScene& scene, std::span<const Eigen::Vector3d> points) {
  std::vector<Eigen::Vector3d> upright;
  upright.reserve(points.size());
  for (const Eigen::Vector3d& p : points) {
    const Eigen::Vector2d ground = scene.ground.Coordinates(p);
    upright.emplace_back(ground.x(), ground.y(), scene.up.dot(p));
  }
  return upright;
}

Eigen::AlignedBox3d UprightBox(std::span<const Eigen::Vector3d> points) {
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& p : points) box.extend(p);
  return box;
}

// The largest ratio of horizontal distance to height of the rays from points in `box` to the cameras; infinite if a
// camera is not above all points. `box` in the coordinates of UprightPoints.
double LargestRun(const SheetInput& input, const Eigen::AlignedBox3d& box) {
  double run = 0;
  for (const SceneView& view : input.views) {
    const Eigen::Vector3d centre = view.camera.Centre();
    const Eigen::Vector3d camera = UprightPoints(input.scene, {&centre, 1})[0];
    const double height_m = camera.z() - box.max().z();
    if (!(height_m > 0)) return std::numeric_limits<double>::infinity();
    const Eigen::Vector3d away = (camera - box.min()).cwiseAbs().cwiseMax((camera - box.max()).cwiseAbs());
    run = std::max(run, away.head<2>().norm() / height_m);
  }
  return run;
}

// The faces of `neighbour` that are high enough, for their distance from the sheet's `box`, to hide a point in it.
std::vector<Triangle> HidingFaces(const SheetInput& input, const Sheet& neighbour, const Eigen::AlignedBox3d& box,
                                  double run) {
  const std::vector<Eigen::Vector3d> upright = UprightPoints(input.scene, neighbour.vertices);
  std::vector<Triangle> faces;
  for (const Triangle& face : neighbour.faces) {
    const Eigen::AlignedBox3d face_box = UprightBox(std::array{upright[face[0]], upright[face[1]], upright[face[2]]});
    const Eigen::Vector3d gap = (face_box.min() - box.max()).cwiseMax(box.min() - face_box.max()).cwiseMax(0);
    if (gap.head<2>().norm() <= run * (face_box.max().z() - box.min().z())) faces.push_back(face);
  }
  return faces;
}

// Gives the vertices with seen = 0 the mean colour of their coloured neighbours, ring by ring.
void FillUnseen(const Sheet& sheet, std::vector<uint8_t> seen, std::vector<Rgb>* colors) {
  struct Sum {
    std::array<uint32_t, 3> rgb = {};
    uint32_t count = 0;
  };
  std::vector<Triangle> open;  // faces with an unseen vertex
  std::copy_if(sheet.faces.begin(), sheet.faces.end(), std::back_inserter(open),
               [&](const Triangle& face) { return seen[face[0]] == 0 || seen[face[1]] == 0 || seen[face[2]] == 0; });
  std::vector<Sum> sums(open.empty() ? 0 : seen.size());
  std::vector<uint32_t> ring;
  do {
    ring.clear();
    for (const Triangle& face : open) {
      for (const uint32_t to : face) {
        if (seen[to] != 0) continue;
        for (const uint32_t from : face) {
          if (seen[from] == 0) continue;
          for (int c = 0; c < 3; ++c) sums[to].rgb[c] += (*colors)[from][c];
          if (sums[to].count++ == 0) ring.push_back(to);
        }
      }
    }
    for (const uint32_t v : ring) {
      const Sum& sum = sums[v];
      for (int c = 0; c < 3; ++c) {
        (*colors)[v][c] = static_cast<uint8_t>((sum.rgb[c] + sum.count / 2) / sum.count);
      }
      seen[v] = 1;
    }
    std::erase_if(open,
                  [&](const Triangle& face) { return seen[face[0]] != 0 && seen[face[1]] != 0 && seen[face[2]] != 0; });
  } while (!ring.empty());
  for (size_t v = 0; v < seen.size(); ++v) {
    if (seen[v] == 0) (*colors)[v] = kUnknownColor;
  }
}

}  // namespace

Status ColorSheet(const SheetInput& input, std::vector<Rgb>* colors, const TaskControl& control, double* unseen_share) {
  const size_t count = input.sheet.vertices.size();
  std::vector<Eigen::Vector3f> normals(count);
  std::vector<float> spacing_m(count);
  {
    const VertexShapes shapes = ShapesOf(input);
    for (size_t v = 0; v < count; ++v) {
      normals[v] = shapes.normals[v].stableNormalized().cast<float>();
      spacing_m[v] = static_cast<float>(shapes.edge_sums[v] / std::max(1u, shapes.edge_counts[v]));
    }
  }
  const Eigen::AlignedBox3d box = UprightBox(UprightPoints(input.scene, input.sheet.vertices));
  const double run = LargestRun(input, box);
  std::vector<std::vector<Triangle>> hiding;
  std::vector<MeshSpans> occluders = {input.sheet.mesh()};
  for (const Sheet& neighbour : input.neighbours) {
    hiding.push_back(HidingFaces(input, neighbour, box, run));
    occluders.push_back(neighbour.mesh());
    occluders.back().faces = hiding.back();
    occluders.back().labels = {};
  }
  PointColorInput points;
  points.points = input.sheet.vertices;
  points.normals = normals;
  points.occluders = occluders;
  points.views = input.views;
  points.view_files = input.view_files;
  points.mask_files = input.mask_files;
  points.spacing_m = spacing_m;
  std::vector<uint8_t> seen;
  TESSERA_RETURN_IF_ERROR(ColorPoints(points, colors, &seen, control));
  if (unseen_share != nullptr) {
    *unseen_share =
        count == 0 ? 0 : static_cast<double>(std::count(seen.begin(), seen.end(), 0)) / static_cast<double>(count);
  }
  FillUnseen(input.sheet, std::move(seen), colors);
  return absl::OkStatus();
}

}  // namespace tessera
