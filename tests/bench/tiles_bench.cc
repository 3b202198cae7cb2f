// How many triangles a viewer draws of 3D Tiles at 1,280 x 800 pixels and an error of 8 pixels, at most.
//   tiles_bench TILESET            a folder with tileset.json
//   tiles_bench --mesh MESH [--gsd M] [--widths KM,KM] [--out DIR]
// The second form makes a city of any width: copies of MESH fill the square of a sheet, whose mesh continues on the
// other side, and equal sheets fill the plane. So all tiles of a level are equal, and one of each is made, as the
// export makes it. Prints tiles by level, CPU microseconds per face of the sheet, and the camera with the most
// triangles. `--out` writes the tiles above the sheet: LEVEL.glb.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "common/exporting/tiles3d/tiles3d.h"
#include "common/exporting/tiles3d/tiles3d_glb.h"
#include "common/exporting/tiles3d/tiles3d_upper.h"
#include "common/meshio/mesh_format.h"
#include "tests/support/tileset_views.h"

namespace tessera {
namespace {

double CpuSeconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

void Print(const char* name, const LargestView& view) {
  const ViewCamera& c = view.camera;
  std::printf("%-10s %8.0f thousand triangles from (%.0f, %.0f, %.0f), view %.2f %.2f %.2f, %.0f degrees\n", name,
              view.triangles / 1e3, c.position.x(), c.position.y(), c.position.z(), c.forward.x(), c.forward.y(),
              c.forward.z(), c.vertical_rad * 57.29578);
}

struct LevelFigures {
  int tiles = 0;
  double triangles = 0, most = 0, error_m = 0, side_m = 0;
};

// `level`: of the tile below the root.
void AddLevels(const ViewTile& tile, int level, std::map<int, LevelFigures>* levels) {
  LevelFigures& figures = (*levels)[level];
  ++figures.tiles;
  figures.triangles += tile.triangles;
  figures.most = std::max(figures.most, tile.triangles);
  figures.error_m = std::max(figures.error_m, tile.error_m);
  figures.side_m = std::max({figures.side_m, tile.box.sizes().x(), tile.box.sizes().y()});
  for (const ViewTile& child : tile.children) AddLevels(child, level + 1, levels);
}

void PrintLevels(const ViewTile& root) {
  std::map<int, LevelFigures> levels;
  AddLevels(root, 0, &levels);
  std::printf("%6s %8s %10s %10s %10s %10s\n", "depth", "tiles", "side, m", "triangles", "most", "error, m");
  for (const auto& [level, figures] : levels) {
    std::printf("%6d %8d %10.1f %10.0f %10.0f %10.3f\n", level, figures.tiles, figures.side_m,
                figures.triangles / figures.tiles, figures.most, figures.error_m);
  }
}

Eigen::AlignedBox2d GroundOf(const Eigen::AlignedBox3d& box) { return {box.min().head<2>(), box.max().head<2>()}; }

void BenchTileset(const std::string& folder) {
  const ViewTile root = ReadTileset(folder);
  PrintLevels(root);
  LargestView largest;
  ForEachCamera(GroundOf(root.box), root.box.min().z(), [&](const ViewCamera& camera) {
    largest.Add(TrianglesInView(root, Eigen::Vector3d::Zero(), camera), camera);
  });
  Print("largest", largest);
}

// The part of a polygon with coordinate `axis` at most `limit`, or at least, if `sign` is -1. Points of the cut depend
// on the ends of the edge alone.
std::vector<Eigen::Vector3d> Clip(const std::vector<Eigen::Vector3d>& polygon, int axis, double limit, double sign) {
  std::vector<Eigen::Vector3d> out;
  for (size_t i = 0; i < polygon.size(); ++i) {
    Eigen::Vector3d a = polygon[i], b = polygon[(i + 1) % polygon.size()];
    const bool a_in = sign * (a[axis] - limit) <= 0, b_in = sign * (b[axis] - limit) <= 0;
    if (a_in) out.push_back(a);
    if (a_in == b_in || a[axis] == limit || b[axis] == limit) continue;
    if (std::lexicographical_compare(b.begin(), b.end(), a.begin(), a.end())) std::swap(a, b);
    Eigen::Vector3d cut = a + (limit - a[axis]) / (b[axis] - a[axis]) * (b - a);
    cut = (cut / kTiles3dGrid_m).array().round() * kTiles3dGrid_m;
    cut[axis] = limit;
    out.push_back(cut);
  }
  return out;
}

// A square of half the side, cut from the middle of the mesh, and its mirror images: a sheet whose mesh continues at
// its other sides without gaps.
Sheet PeriodicSheet(const TriangleMesh& mesh, double side_m) {
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& p : mesh.vertices) box.extend(p);
  const double half_m = side_m / 2;
  Eigen::Vector3d corner = box.center() - Eigen::Vector3d(half_m, half_m, 0) / 2;
  corner.z() = box.min().z();
  Sheet sheet;
  std::map<std::array<double, 3>, uint32_t> numbers;
  const auto number = [&](const Eigen::Vector3d& p) {
    const auto [it, is_new] = numbers.try_emplace({p.x(), p.y(), p.z()}, static_cast<uint32_t>(sheet.vertices.size()));
    if (is_new) sheet.vertices.push_back(p);
    return it->second;
  };
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    std::vector<Eigen::Vector3d> polygon;
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d p = mesh.Corner(f, k) - corner;
      polygon.push_back((p / kTiles3dGrid_m).array().round() * kTiles3dGrid_m);
    }
    for (const int axis : {0, 1}) polygon = Clip(Clip(polygon, axis, 0, -1), axis, half_m, 1);
    for (size_t i = 2; i < polygon.size(); ++i) {
      for (int image = 0; image < 4; ++image) {
        std::array<Eigen::Vector3d, 3> corners = {polygon[0], polygon[i - 1], polygon[i]};
        Eigen::Vector3d centroid(0, 0, 0);
        for (Eigen::Vector3d& p : corners) {
          if (image % 2 == 1) p.x() = side_m - p.x();
          if (image / 2 == 1) p.y() = side_m - p.y();
          p += Eigen::Vector3d(side_m / 4, side_m / 4, 0);  // so that no mirror is at the sheet's side
          centroid += p / 3;
        }
        if (image == 1 || image == 2) std::swap(corners[1], corners[2]);
        const Eigen::Vector3d shift(centroid.x() < side_m ? 0 : -side_m, centroid.y() < side_m ? 0 : -side_m, 0);
        const Triangle face = {number(corners[0] + shift), number(corners[1] + shift), number(corners[2] + shift)};
        if (face[0] == face[1] || face[1] == face[2] || face[2] == face[0]) continue;
        sheet.faces.push_back(face);
        sheet.labels.push_back(mesh.labels.empty() ? -1 : mesh.labels[f]);
      }
    }
  }
  sheet.shared.assign(sheet.vertices.size(), 0);
  for (uint32_t v = 0; v < sheet.vertices.size(); ++v) {
    for (int i = 0; i < 9 && !sheet.shared[v]; ++i) {
      const Eigen::Vector3d p = sheet.vertices[v] + side_m * Eigen::Vector3d(i % 3 - 1, i / 3 - 1, 0);
      sheet.shared[v] = i != 4 && numbers.contains({p.x(), p.y(), p.z()}) ? 1 : 0;
    }
  }
  return sheet;
}

// A city of equal sheets.
class PeriodicCity {
 public:
  explicit PeriodicCity(const Tiles3dSizes& sizes) : sizes_(sizes) {}

  // `out`: a folder for the tiles above the sheet; empty: none.
  Status Make(const TriangleMesh& mesh, double gsd_m, double largest_m, const std::string& out) {
    ExportScene scene;
    scene.gsd_m = gsd_m;
    side_m_ = std::round(250 * gsd_m / kTiles3dGrid_m) * kTiles3dGrid_m * 4;
    scene.ground.cell_m = side_m_ / kSheetCells;
    for (int i = 0; i < 8; ++i) scene.classes.emplace_back().name = "class";
    const ExportOptions options;
    const Sheet sheet = PeriodicSheet(mesh, side_m_);
    TESSERA_ASSIGN_OR_RETURN(const TempFolder folder, TempFolder::Create("/tmp", "tiles-bench-"));
    double start_s = CpuSeconds();
    const SheetInput input{scene, options, {0, 0}, sheet};
    TESSERA_RETURN_IF_ERROR(WriteTiles3dSheet(input, folder.path(), TaskControl(), sizes_).status());
    std::printf("a sheet of %.0f m has %zu faces; %.2f us of CPU a face\n", side_m_, sheet.faces.size(),
                1e6 * (CpuSeconds() - start_s) / static_cast<double>(sheet.faces.size()));
    TESSERA_ASSIGN_OR_RETURN(Tiles3dPart part, ReadTiles3dPart(folder.path() + "/" + kPartFile, "result"));
    levels_.push_back(ReadTileset(folder.path() + "/result/0_0"));
    PrintLevels(levels_[0]);
    std::printf("%6s %8s %10s %10s %10s %10s\n", "level", "", "side, m", "triangles", "CPU, s", "error, m");
    for (double side_m = side_m_; side_m < largest_m; side_m *= 2) {
      start_s = CpuSeconds();
      Raise(side_m, &part);
      const ViewTile& tile = levels_.back();
      if (!out.empty()) {
        TESSERA_RETURN_IF_ERROR(
            WriteFileAtomic(out + "/" + std::to_string(levels_.size() - 1) + ".glb",
                            MakeTiles3dGlb(part.mesh.vertices, part.mesh.faces, scene.classes, false)));
      }
      std::printf("%6zu %8s %10.1f %10.0f %10.2f %10.3f\n", levels_.size() - 1, "", 2 * side_m, tile.triangles,
                  CpuSeconds() - start_s, tile.error_m);
    }
    return absl::OkStatus();
  }

  LargestView Largest(double width_m) const {
    const int count = std::max(1, static_cast<int>(std::round(width_m / side_m_)));
    size_t level = 0;
    while ((1 << level) < count) ++level;
    LargestView largest;
    const Eigen::AlignedBox2d city(Eigen::Vector2d(0, 0), Eigen::Vector2d(count * side_m_, count * side_m_));
    ForEachCamera(city, levels_[0].box.min().z(), [&](const ViewCamera& camera) {
      largest.Add(Triangles(level, {0, 0, 0}, count * side_m_, camera), camera);
    });
    return largest;
  }

 private:
  static void Move(const Eigen::Vector3d& shift, Tiles3dPart* part) {
    for (Eigen::Vector3d& p : part->mesh.vertices.positions) p += shift;
    for (Tiles3dPoint& point : part->samples) point.position += shift;
    part->box.translate(shift);
  }

  // Replaces the part of a tile with this side by that of its parent; adds the parent to levels_.
  void Raise(double side_m, Tiles3dPart* part) {
    std::vector<Tiles3dPart> children;
    for (int i = 0; i < 4; ++i) {
      Tiles3dPart child = *part;
      Move(side_m * Eigen::Vector3d(i % 2, i / 2, 0), &child);
      children.push_back(std::move(child));
    }
    *part = MergeTiles3dParts(std::move(children));
    std::vector<std::vector<Tiles3dEdge>> borders;
    const std::vector<Eigen::Vector3d>& positions = part->mesh.vertices.positions;
    const auto edges = Tiles3dSharedEdges(part->mesh.vertices, part->mesh.faces);
    for (int i = 0; i < 9; ++i) {
      if (i == 4) continue;
      const Eigen::Vector3d shift = 2 * side_m * Eigen::Vector3d(i % 3 - 1, i / 3 - 1, 0);
      std::vector<Tiles3dEdge>& border = borders.emplace_back();
      for (const auto& [a, b] : edges) border.push_back({positions[a] + shift, positions[b] + shift});
    }
    ViewTile tile;
    tile.error_m = SimplifyTiles3dPart(borders, 2 * side_m, levels_.back().error_m, false, sizes_, part);
    tile.box = part->box;
    tile.triangles = static_cast<double>(part->mesh.faces.size());
    levels_.push_back(tile);
  }

  // Of the tile of `level` at `at`, in a city of this width.
  double Triangles(size_t level, const Eigen::Vector3d& at, double width_m, const ViewCamera& camera) const {
    if (at.x() >= width_m || at.y() >= width_m) return 0;
    if (level == 0) return TrianglesInView(levels_[0], at, camera);
    const ViewTile& tile = levels_[level];
    Eigen::AlignedBox3d box = tile.box;
    box.translate(at);
    const double margin_m = side_m_ / 4;  // faces reach over the side of their sheet
    box.max() = box.max().cwiseMin(Eigen::Vector3d(width_m + margin_m, width_m + margin_m, box.max().z()));
    if (!camera.Sees(box)) return 0;
    // A tile at the city's side has no more triangles than one inside.
    if (camera.Pixels(box, tile.error_m) <= kViewError_px) return tile.triangles;
    double sum = 0;
    const double half_m = std::ldexp(side_m_, static_cast<int>(level) - 1);
    for (int q = 0; q < 4; ++q) {
      sum += Triangles(level - 1, at + half_m * Eigen::Vector3d(q % 2, q / 2, 0), width_m, camera);
    }
    return sum;
  }

  const Tiles3dSizes sizes_;
  double side_m_ = 0;
  std::vector<ViewTile> levels_;  // 0: a sheet, with its tiles; one tile of each level above
};

int Main(int argc, char** argv) {
  std::string tileset, mesh_path, out;
  double gsd_m = 0.11;
  std::vector<double> widths_km = {0.5, 1, 2, 4, 8, 12, 16, 33};
  CLI::App app("Triangles in view of 3D Tiles");
  app.add_option("tileset", tileset, "folder with tileset.json");
  app.add_option("--mesh", mesh_path, "make a city of copies of this mesh");
  app.add_option("--out", out, "existing folder for the tiles above the sheet");
  Tiles3dSizes sizes;
  app.add_option("--error", sizes.error, "of a level, as a part of a tile's side");
  app.add_option("--gsd", gsd_m, "ground sampling distance, metres: a sheet is 1,000 wide");
  app.add_option("--widths", widths_km, "of the city, kilometres")->delimiter(',');
  CLI11_PARSE(app, argc, argv);
  if (!tileset.empty()) BenchTileset(tileset);
  if (mesh_path.empty()) return 0;
  const StatusOr<MeshContent> mesh = ReadMesh(mesh_path);
  if (!mesh.ok()) {
    std::fprintf(stderr, "%s\n", mesh.status().ToString().c_str());
    return 1;
  }
  PeriodicCity city(sizes);
  const Status made = city.Make(mesh->mesh, gsd_m, 1000 * *std::max_element(widths_km.begin(), widths_km.end()), out);
  if (!made.ok()) {
    std::fprintf(stderr, "%s\n", made.ToString().c_str());
    return 1;
  }
  for (const double width_km : widths_km) {
    Print((std::to_string(static_cast<int>(1000 * width_km)) + " m").c_str(), city.Largest(1000 * width_km));
  }
  return 0;
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) {
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  return tessera::Main(argc, argv);
}
