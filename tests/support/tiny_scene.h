// A small valid scene on disk, for tests: a box on flat ground, photographed from five sides, with likelihoods and a
// COLMAP text model whose 3D points and image points fit exactly.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"
#include "common/imaging/raster.h"

namespace tessera {

struct TinySceneOptions {
  enum class Likelihoods { kTiff, kNpy, kLabelPng, kNone };
  Likelihoods likelihoods = Likelihoods::kTiff;
  bool coarse_likelihoods = false;                   // of half the photographs' width and height (kTiff, kNpy)
  bool labels = true;                                // of the mesh
  bool absent_class = false;                         // a fourth one, of likelihood 0 everywhere (kTiff, kNpy)
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();  // of the whole scene in its coordinates
  std::string crs_json = R"({"type": "local"})";
  // 4 x 12 x 16 m of class roof all over, 6 m from the box, and four more views that look past it at the side behind
  // it.
  bool tower = false;
  int finer = 1;  // times the pixels a side; of MakeTinyScene alone
  // OPENCV distortion of the photographs; with the second row, TESSERA_BROWN.
  double k1 = 0, k2 = 0;
  double k4 = 0, skew_px = 0;
};

struct TinyScene {
  TriangleMesh mesh;  // classes: 0 ground, 1 facade, 2 roof; the scene's coordinates, the truth and the start alike
  std::vector<PosedCamera> cameras;  // undistorted
  std::vector<std::string> image_names;
  std::vector<LabelImage> label_pictures;  // undistorted class ids, 255 where nothing is seen
  std::vector<FloatImage> pictures;        // undistorted luminance in [0, 1] as rendered, NaN where nothing is seen
};

// The scene without its files. 40 x 40 m of ground, a box of 12 x 12 x 8 m, quads of 2 m in two triangles each (a
// manifold with one boundary); 160 x 120 pixels, GSD about 0.2 m.
TinyScene MakeTinyScene(const TinySceneOptions& options = {});

// Writes it to `folder` (made if missing) and returns it. Aborts the test if it cannot.
TinyScene WriteTinyScene(const std::string& folder, const TinySceneOptions& options = {});

// An empty folder below testing::TempDir() for the running test.
std::string FreshTestFolder(const std::string& name);

// Text files, whole.
std::string ReadText(const std::string& path);
void WriteText(const std::string& path, const std::string& text);
// Replaces the first occurrence of `from` in the file; aborts the test if there is none.
void ReplaceInFile(const std::string& path, const std::string& from, const std::string& to);

// The mesh as an ASCII PLY with positions of type `position_type` ("float" or "double").
std::string AsciiPly(const TriangleMesh& mesh, const std::string& position_type);

}  // namespace tessera
