// Writes a folder of OBJ tiles as ContextCapture does, with a surface whose height is known.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>

#include "absl/strings/str_format.h"

namespace tessera {

struct TileFolder {
  int tiles_x = 2, tiles_y = 2;
  int cells = 4;  // squares of two triangles along a tile's side
  double cell_m = 0.5;
  // By how much the vertices of a tile differ from the surface; the same for all vertices of a tile.
  double (*shift_x_m)(int tile_x, int tile_y) = [](int, int) { return 0.0; };
  bool soup = false;  // three vertices of its own for each face

  static double Height(double x, double y) { return 30 + 2 * std::sin(0.7 * x) * std::cos(0.4 * y); }
  static std::string TileName(int tile_x, int tile_y) { return absl::StrFormat("Tile_%+04d_%+04d", tile_x, tile_y); }

  int64_t FacesOfTile() const { return int64_t{2} * cells * cells; }
  // Of the merged mesh.
  int64_t Vertices() const { return (int64_t{tiles_x} * cells + 1) * (int64_t{tiles_y} * cells + 1); }
  int64_t Faces() const { return FacesOfTile() * tiles_x * tiles_y; }

  std::string Tile(int tile_x, int tile_y) const {
    std::string text = "mtllib tile.mtl\n", faces;
    const auto vertex = [&](int i, int j) {
      const double x = (tile_x * cells + i) * cell_m, y = (tile_y * cells + j) * cell_m;
      return absl::StrFormat("v %.6f %.6f %.6f\n", x + shift_x_m(tile_x, tile_y), y, Height(x, y));
    };
    for (int j = 0; j <= cells && !soup; ++j) {
      for (int i = 0; i <= cells; ++i) text += vertex(i, j);
    }
    int next = 1;
    for (int j = 0; j < cells; ++j) {
      faces += j < cells / 2 ? "usemtl Roof 1\n" : "usemtl Wall\n";
      for (int i = 0; i < cells; ++i) {
        const int corners[6][2] = {{i, j}, {i + 1, j}, {i + 1, j + 1}, {i, j}, {i + 1, j + 1}, {i, j + 1}};
        int numbers[6];
        for (int k = 0; k < 6; ++k) {
          if (soup) text += vertex(corners[k][0], corners[k][1]);
          numbers[k] = soup ? next++ : corners[k][1] * (cells + 1) + corners[k][0] + 1;
        }
        for (int k = 0; k < 6; k += 3) {
          absl::StrAppendFormat(&faces, "f %d/1 %d/1 %d/1\n", numbers[k], numbers[k + 1], numbers[k + 2]);
        }
      }
    }
    return text + faces;
  }

  // Writes FOLDER/metadata.xml and FOLDER/Data/Tile_+001_-002/Tile_+001_-002.obj and so on.
  void Write(const std::string& folder) const {
    namespace fs = std::filesystem;
    fs::remove_all(folder);
    for (int y = 0; y < tiles_y; ++y) {
      for (int x = 0; x < tiles_x; ++x) {
        const fs::path of_tile = fs::path(folder) / "Data" / TileName(x, y);
        fs::create_directories(of_tile);
        std::ofstream(of_tile / (TileName(x, y) + ".obj"), std::ios::binary) << Tile(x, y);
        std::ofstream(of_tile / (TileName(x, y) + ".mtl")) << "newmtl Wall\n";
      }
    }
    std::ofstream(fs::path(folder) / "metadata.xml")
        << "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<ModelMetadata version=\"1\">\n<!--System-->\n"
           "<SRS>EPSG:32632</SRS>\n<SRSOrigin>691000.5,5334000.25,500</SRSOrigin>\n</ModelMetadata>\n";
  }
};

}  // namespace tessera
