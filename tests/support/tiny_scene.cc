#include "tests/support/tiny_scene.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <map>

#include "absl/strings/str_cat.h"
#include "common/base/random.h"
#include "common/geometry/ray_caster.h"
#include "common/imaging/image_io.h"
#include "common/meshio/ply.h"

namespace tessera {
namespace {

constexpr double kCell_m = 2;
constexpr int kCells = 20;
constexpr int kWidth = 160, kHeight = 120;
constexpr double kFocal_px = 170;

[[noreturn]] void Fail(const std::string& what) {
  std::fprintf(stderr, "tiny scene: %s\n", what.c_str());
  std::abort();
}
void Require(const Status& status) {
  if (!status.ok()) Fail(std::string(status.message()));
}

// Vertices on integer positions, shared by all quads that name them.
class GridMesh {
 public:
  void AddQuad(const std::array<Eigen::Vector3i, 4>& corners, const Eigen::Vector3d& outside, int label) {
    std::array<uint32_t, 4> v;
    for (int k = 0; k < 4; ++k) v[k] = Vertex(corners[k]);
    const Eigen::Vector3d normal =
        (corners[1] - corners[0]).cast<double>().cross((corners[2] - corners[0]).cast<double>());
    if (normal.dot(outside) < 0) std::swap(v[1], v[3]);
    mesh.faces.push_back({v[0], v[1], v[2]});
    mesh.faces.push_back({v[0], v[2], v[3]});
    mesh.labels.insert(mesh.labels.end(), 2, label);
  }
  TriangleMesh mesh;

 private:
  uint32_t Vertex(const Eigen::Vector3i& p) {
    const auto [it, is_new] = index_.try_emplace({p.x(), p.y(), p.z()}, static_cast<uint32_t>(mesh.vertices.size()));
    if (is_new) mesh.vertices.push_back(kCell_m * (p.cast<double>() - Eigen::Vector3d(kCells / 2, kCells / 2, 0)));
    return it->second;
  }
  std::map<std::array<int, 3>, uint32_t> index_;
};

// Upright and on the ground, in cells.
struct Box {
  int x0, y0, x1, y1, height;
  int side_label, top_label;
  bool Contains(int x, int y) const { return x >= x0 && x < x1 && y >= y0 && y < y1; }
};
constexpr Box kHouse = {7, 7, 13, 13, 4, 1, 2}, kTower = {16, 6, 18, 12, 8, 2, 2};

TriangleMesh BoxesOnGround(const std::vector<Box>& boxes) {
  GridMesh grid;
  for (int y = 0; y < kCells; ++y) {
    for (int x = 0; x < kCells; ++x) {
      int z = 0, label = 0;
      for (const Box& box : boxes) {
        if (box.Contains(x, y)) z = box.height, label = box.top_label;
      }
      grid.AddQuad({{{x, y, z}, {x + 1, y, z}, {x + 1, y + 1, z}, {x, y + 1, z}}}, Eigen::Vector3d::UnitZ(), label);
    }
  }
  for (const Box& box : boxes) {
    for (int y = box.y0; y < box.y1; ++y) {
      for (int z = 0; z < box.height; ++z) {
        for (const int x : {box.x0, box.x1}) {
          grid.AddQuad({{{x, y, z}, {x, y + 1, z}, {x, y + 1, z + 1}, {x, y, z + 1}}},
                       (x == box.x0 ? -1 : 1) * Eigen::Vector3d::UnitX(), box.side_label);
        }
      }
    }
    for (int x = box.x0; x < box.x1; ++x) {
      for (int z = 0; z < box.height; ++z) {
        for (const int y : {box.y0, box.y1}) {
          grid.AddQuad({{{x, y, z}, {x + 1, y, z}, {x + 1, y, z + 1}, {x, y, z + 1}}},
                       (y == box.y0 ? -1 : 1) * Eigen::Vector3d::UnitY(), box.side_label);
        }
      }
    }
  }
  return std::move(grid.mesh);
}

double Lattice(int64_t x, int64_t y, int64_t z) {
  const uint64_t bits = MixBits(static_cast<uint64_t>(x) * 73856093u ^ static_cast<uint64_t>(y) * 19349663u ^
                                static_cast<uint64_t>(z) * 83492791u);
  return static_cast<double>(bits >> 11) * 0x1.0p-53;
}

// Smooth noise of one wavelength, in [0, 1].
double Noise(const Eigen::Vector3d& p) {
  double value = 0;
  const Eigen::Vector3d base = p.array().floor();
  const Eigen::Vector3d f = (p - base).unaryExpr([](double t) { return t * t * (3 - 2 * t); });
  for (int k = 0; k < 8; ++k) {
    const int i = k & 1, j = k >> 1 & 1, l = k >> 2;
    value += (i ? f.x() : 1 - f.x()) * (j ? f.y() : 1 - f.y()) * (l ? f.z() : 1 - f.z()) *
             Lattice(static_cast<int64_t>(base.x()) + i, static_cast<int64_t>(base.y()) + j,
                     static_cast<int64_t>(base.z()) + l);
  }
  return value;
}

double Texture(const Eigen::Vector3d& p, int label) {
  return 0.1 + 0.15 * label + 0.3 * Noise(p / 2.5 + Eigen::Vector3d(0.5, 0.5, 0.5)) + 0.2 * Noise(p / 0.9);
}

PosedCamera LookAt(const Eigen::Vector3d& centre, const Eigen::Vector3d& target, int finer) {
  const Eigen::Vector3d z = (target - centre).normalized();
  const Eigen::Vector3d side = std::abs(z.z()) > 0.99 ? Eigen::Vector3d::UnitX() : z.cross(Eigen::Vector3d::UnitZ());
  const Eigen::Vector3d x = side.normalized(), y = z.cross(x);
  PosedCamera camera;
  camera.intrinsics = {finer * kWidth,    finer * kHeight,      finer * kFocal_px,
                       finer * kFocal_px, finer * kWidth / 2.0, finer * kHeight / 2.0};
  camera.rotation_cam_from_world << x.transpose(), y.transpose(), z.transpose();
  camera.translation_cam_from_world = -camera.rotation_cam_from_world * centre;
  return camera;
}

LensModel Lens(const TinySceneOptions& options, const PinholeCamera& pinhole) {
  LensModel lens;
  lens.pinhole = pinhole;
  lens.coefficients[0] = options.k1;
  lens.coefficients[1] = options.k2;
  if (options.k1 != 0 || options.k2 != 0) lens.kind = LensModel::Kind::kOpenCv;
  if (options.k4 != 0 || options.skew_px != 0) {
    lens.kind = LensModel::Kind::kBrown;
    lens.coefficients[5] = options.k4;
    lens.coefficients[6] = options.skew_px;
  }
  return lens;
}

struct Picture {
  FloatImage luminance;
  LabelImage labels;
};

// What the camera photographs through the lens; a pixel's value is that of its centre.
Picture Render(const TriangleMesh& mesh, const RayCaster& caster, const PosedCamera& camera, const LensModel& lens,
               const Eigen::Vector3d& offset) {
  const int width = camera.intrinsics.width, height = camera.intrinsics.height;
  Picture picture{FloatImage(width, height, 1, NAN), LabelImage(width, height, 1, 255)};
  const Eigen::Vector3d centre = camera.Centre();
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const Eigen::Vector2d seen(x + 0.5, y + 0.5);
      Eigen::Vector2d p = seen;
      for (int i = 0; i < 30 && lens.kind != LensModel::Kind::kPinhole; ++i) p -= lens.Distort(p) - seen;
      const Eigen::Vector3d ray = camera.Ray(p.x(), p.y());
      const RayHit hit = caster.Cast(centre, ray);
      if (!hit.hit()) continue;
      const int label = mesh.labels[hit.face];
      picture.luminance.at(x, y) = static_cast<float>(Texture(centre + hit.distance * ray - offset, label));
      picture.labels.at(x, y) = static_cast<uint8_t>(label);
    }
  }
  return picture;
}

// Every second pixel of every second row.
ByteImage EverySecond(const ByteImage& image) {
  ByteImage out(image.width / 2, image.height / 2, image.channels);
  for (int c = 0; c < image.channels; ++c) {
    for (int y = 0; y < out.height; ++y) {
      for (int x = 0; x < out.width; ++x) out.at(x, y, c) = image.at(2 * x, 2 * y, c);
    }
  }
  return out;
}

ByteImage LikelihoodsOf(const LabelImage& labels, bool absent_class) {
  ByteImage pages(labels.width, labels.height, absent_class ? 4 : 3, 25);
  if (absent_class) std::fill_n(pages.plane(3), pages.plane_size(), 0);
  for (size_t i = 0; i < labels.data.size(); ++i) {
    if (labels.data[i] < 3) pages.plane(labels.data[i])[i] = 200;
  }
  return pages;
}

std::string NpyOf(const ByteImage& pages) {
  std::string header = absl::StrCat("{'descr': '|u1', 'fortran_order': False, 'shape': (", pages.channels, ", ",
                                    pages.height, ", ", pages.width, "), }");
  while ((10 + header.size() + 1) % 64 != 0) header += ' ';
  header += '\n';
  std::string npy("\x93NUMPY\x01\x00", 8);
  npy += static_cast<char>(header.size() & 255);
  npy += static_cast<char>(header.size() >> 8);
  return npy + header + std::string(pages.data.begin(), pages.data.end());
}

void WriteColmap(const std::string& folder, const TinySceneOptions& options, const TinyScene& scene) {
  char line[512];
  std::string cameras = "# one camera for all\n", images = "# two lines an image\n", points;
  const bool is_brown = options.k4 != 0 || options.skew_px != 0;
  std::snprintf(line, sizeof line, "1 %s %d %d %.17g %.17g %.17g %.17g %.17g %.17g 0 0",
                is_brown ? "TESSERA_BROWN" : "OPENCV", kWidth, kHeight, kFocal_px, kFocal_px, kWidth / 2.0,
                kHeight / 2.0, options.k1, options.k2);
  cameras += line;
  if (is_brown) absl::StrAppend(&cameras, " 0 ", options.k4, " ", options.skew_px);
  cameras += "\n";
  std::map<size_t, std::string> tracks;
  for (size_t i = 0; i < scene.cameras.size(); ++i) {
    const PosedCamera& camera = scene.cameras[i];
    const Eigen::Quaterniond q(camera.rotation_cam_from_world);
    const Eigen::Vector3d& t = camera.translation_cam_from_world;
    std::snprintf(line, sizeof line, "%zu %.17g %.17g %.17g %.17g %.17g %.17g %.17g 1 %s\n", i + 1, q.w(), q.x(), q.y(),
                  q.z(), t.x(), t.y(), t.z(), scene.image_names[i].c_str());
    images += line;
    const LensModel lens = Lens(options, camera.intrinsics);
    int index = 0;
    for (size_t v = 0; v < scene.mesh.vertices.size(); v += 7) {
      const Eigen::Vector3d projected = camera.Project(scene.mesh.vertices[v]);
      if (!camera.InImage(projected)) continue;
      const Eigen::Vector2d p = lens.Distort(projected.head<2>());
      if (p.x() < 0 || p.y() < 0 || p.x() >= kWidth || p.y() >= kHeight) continue;
      std::snprintf(line, sizeof line, "%.6f %.6f %zu ", p.x(), p.y(), v + 1);
      images += line;
      absl::StrAppend(&tracks[v], " ", i + 1, " ", index++);
    }
    images += "\n";
  }
  for (const auto& [v, track] : tracks) {
    const Eigen::Vector3d& p = scene.mesh.vertices[v];
    std::snprintf(line, sizeof line, "%zu %.17g %.17g %.17g 128 128 128 0.5", v + 1, p.x(), p.y(), p.z());
    points += line + track + "\n";
  }
  WriteText(folder + "/cameras.txt", cameras);
  WriteText(folder + "/images.txt", images);
  WriteText(folder + "/points3D.txt", points);
}

}  // namespace

TinyScene MakeTinyScene(const TinySceneOptions& options) {
  TinyScene scene;
  scene.mesh = BoxesOnGround(options.tower ? std::vector<Box>{kHouse, kTower} : std::vector<Box>{kHouse});
  for (Eigen::Vector3d& p : scene.mesh.vertices) p += options.offset;
  const Eigen::Vector3d target = options.offset + Eigen::Vector3d(0, 0, 3);
  std::vector<Eigen::Vector3d> centres = {{0, 0, 34}, {26, 3, 24}, {-26, -3, 24}, {3, 26, 24}, {-3, -26, 24}};
  if (options.tower) centres.insert(centres.end(), {{30, -15, 18}, {30, -5, 18}, {30, 5, 18}, {30, 15, 18}});
  const RayCaster caster(scene.mesh);
  for (const Eigen::Vector3d& centre : centres) {
    scene.image_names.push_back(absl::StrCat("view", scene.cameras.size(), ".png"));
    scene.cameras.push_back(LookAt(options.offset + centre, target, options.finer));
    LensModel pinhole;
    pinhole.pinhole = scene.cameras.back().intrinsics;
    Picture picture = Render(scene.mesh, caster, scene.cameras.back(), pinhole, options.offset);
    scene.pictures.push_back(std::move(picture.luminance));
    scene.label_pictures.push_back(std::move(picture.labels));
  }
  if (!options.labels) scene.mesh.labels.clear();
  return scene;
}

TinyScene WriteTinyScene(const std::string& folder, const TinySceneOptions& options) {
  using Likelihoods = TinySceneOptions::Likelihoods;
  TinySceneOptions labelled = options;
  labelled.labels = true;
  labelled.finer = 1;
  TinyScene scene = MakeTinyScene(labelled);
  const bool likelihoods = options.likelihoods != Likelihoods::kNone;
  for (const char* name : {"/colmap", "/images", "/likelihoods"}) {
    if (likelihoods || std::string(name) != "/likelihoods") std::filesystem::create_directories(folder + name);
  }
  const RayCaster caster(scene.mesh);
  for (size_t i = 0; i < scene.cameras.size(); ++i) {
    const LensModel lens = Lens(options, scene.cameras[i].intrinsics);
    const Picture picture = lens.kind == LensModel::Kind::kPinhole
                                ? Picture{scene.pictures[i], scene.label_pictures[i]}
                                : Render(scene.mesh, caster, scene.cameras[i], lens, options.offset);
    ByteImage grey(kWidth, kHeight);
    for (size_t k = 0; k < grey.data.size(); ++k) {
      const float value = picture.luminance.data[k];
      grey.data[k] = std::isnan(value) ? 0 : static_cast<uint8_t>(std::lround(255 * std::clamp(value, 0.0f, 1.0f)));
    }
    Require(WritePng(folder + "/images/" + scene.image_names[i], grey));
    const std::string stem = absl::StrCat(folder, "/likelihoods/view", i);
    const ByteImage fine = LikelihoodsOf(picture.labels, options.absent_class);
    const ByteImage pages = options.coarse_likelihoods ? EverySecond(fine) : fine;
    if (options.likelihoods == Likelihoods::kTiff) Require(WriteLikelihoodTiff(stem + ".tif", pages));
    if (options.likelihoods == Likelihoods::kNpy) WriteText(stem + ".npy", NpyOf(pages));
    if (options.likelihoods == Likelihoods::kLabelPng) {
      ByteImage ids(kWidth, kHeight);
      ids.data = picture.labels.data;
      Require(WritePng(stem + ".png", ids));
    }
  }
  WriteColmap(folder + "/colmap", options, scene);
  if (!options.labels) scene.mesh.labels.clear();
  Require(WritePly(folder + "/mesh.ply", scene.mesh));
  WriteText(folder + "/scene.json",
            absl::StrCat("{\n  \"tessera_scene\": 1,\n  \"classes\": [\"ground\", \"facade\", \"roof\"",
                         options.absent_class ? ", \"vegetation\"" : "", "],\n  \"crs\": ", options.crs_json, "\n}\n"));
  return scene;
}

std::string FreshTestFolder(const std::string& name) {
  const testing::TestInfo* test = testing::UnitTest::GetInstance()->current_test_info();
  std::string unique = name;
  if (test != nullptr) unique = std::string(test->test_suite_name()) + "." + test->name() + "." + name;
  std::replace(unique.begin(), unique.end(), '/', '_');
  const std::string folder = testing::TempDir() + unique;
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  return folder;
}

std::string ReadText(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) Fail("cannot read " + path);
  return {std::istreambuf_iterator<char>(in), {}};
}

void WriteText(const std::string& path, const std::string& text) {
  std::ofstream out(path, std::ios::binary);
  if (!(out << text) || !out.flush()) Fail("cannot write " + path);
}

void ReplaceInFile(const std::string& path, const std::string& from, const std::string& to) {
  std::string text = ReadText(path);
  const size_t at = text.find(from);
  if (at == std::string::npos) Fail(path + " has no '" + from + "'");
  WriteText(path, text.replace(at, from.size(), to));
}

std::string AsciiPly(const TriangleMesh& mesh, const std::string& position_type) {
  std::string ply = absl::StrCat("ply\nformat ascii 1.0\nelement vertex ", mesh.vertices.size(), "\n");
  for (const char* axis : {"x", "y", "z"}) absl::StrAppend(&ply, "property ", position_type, " ", axis, "\n");
  absl::StrAppend(&ply, "element face ", mesh.faces.size(), "\nproperty list uchar int vertex_indices\n");
  if (!mesh.labels.empty()) ply += "property int label\n";
  ply += "end_header\n";
  char line[128];
  for (const Eigen::Vector3d& p : mesh.vertices) {
    std::snprintf(line, sizeof line, "%.17g %.17g %.17g\n", p.x(), p.y(), p.z());
    ply += line;
  }
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const Triangle& face = mesh.faces[f];
    std::snprintf(line, sizeof line, "3 %u %u %u", face[0], face[1], face[2]);
    ply += line;
    if (!mesh.labels.empty()) absl::StrAppend(&ply, " ", mesh.labels[f]);
    ply += "\n";
  }
  return ply;
}

}  // namespace tessera
