#include "tests/bench/accuracy/likelihood_ladder.h"

#include <filesystem>
#include <set>
#include <string>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/imaging/image_io.h"
#include "common/storage/files.h"
#include "tests/bench/accuracy/bench_scenes.h"
#include "tests/support/draw_views.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

constexpr uint8_t kUnknown = 255;

struct Rung {
  std::string kind;
  int pixels = 0;  // that borders move outward
};

StatusOr<Rung> ParseRung(const std::string& name) {
  const size_t equal = name.find('=');
  Rung rung = {name.substr(0, equal), 0};
  const bool moves = rung.kind == "grown" || rung.kind == "shrunk";
  if (moves && equal != std::string::npos && absl::SimpleAtoi(name.substr(equal + 1), &rung.pixels) &&
      rung.pixels > 0 && rung.pixels < 100) {
    return rung;
  }
  if (!moves && equal == std::string::npos) {
    for (const char* known : {"truth", "start", "permuted", "uniform", "shipped"}) {
      if (rung.kind == known) return rung;
    }
    if (fs::is_directory(name)) return Rung{"folder", 0};
  }
  return absl::InvalidArgumentError(absl::StrCat(
      "rung '", name, "': expected truth, grown=N, shrunk=N, start, permuted, uniform, shipped or a folder"));
}

// What lies within `radius` of a pixel that `spreads` is given to it: by rows, then by columns of what that gave.
LabelImage Spread(const LabelImage& labels, int radius, const std::set<int>& spreads) {
  const auto pass = [&](const LabelImage& from, int dx, int dy) {
    LabelImage to = from;
    for (int y = 0; y < from.height; ++y) {
      for (int x = 0; x < from.width; ++x) {
        if (from.at(x, y) == kUnknown || spreads.count(from.at(x, y)) > 0) continue;
        for (int k = 1; k <= radius && spreads.count(to.at(x, y)) == 0; ++k) {
          for (const int side : {-k, k}) {
            const int u = x + side * dx, v = y + side * dy;
            if (u < 0 || v < 0 || u >= from.width || v >= from.height || spreads.count(from.at(u, v)) == 0) continue;
            to.at(x, y) = from.at(u, v);
          }
        }
      }
    }
    return to;
  };
  return pass(pass(labels, 1, 0), 0, 1);
}

// Labels of the mesh that each pixel sees.
LabelImage Rendered(const TriangleMesh& mesh, const PosedCamera& camera) {
  const FaceMap map =
      RasterizeFaces(mesh, CameraWindow{camera, {0, 0, camera.intrinsics.width, camera.intrinsics.height}});
  LabelImage labels(map.width, map.height, 1, kUnknown);
  for (size_t at = 0; at < map.face.size(); ++at) {
    const int32_t label = map.face[at] < 0 ? -1 : mesh.labels[map.face[at]];
    if (label >= 0) labels.data[at] = static_cast<uint8_t>(label);
  }
  return labels;
}

}  // namespace

Status MakeRung(const SceneDescription& scene, const std::string& name, const std::string& folder) {
  TESSERA_ASSIGN_OR_RETURN(const Rung rung, ParseRung(name));
  // Where the scene has its own, by whatever name.
  std::string likelihoods = "likelihoods";
  for (const SceneView& view : scene.views) {
    if (view.likelihood_path.empty()) continue;
    likelihoods = view.likelihood_path.substr(0, view.likelihood_path.find('/'));
    break;
  }
  TESSERA_RETURN_IF_ERROR(LinkScene(scene, likelihoods, folder));
  const fs::path to = fs::path(folder) / likelihoods;
  if (rung.kind == "shipped" || rung.kind == "folder") {
    fs::create_symlink(fs::absolute(rung.kind == "folder" ? fs::path(name) : fs::path(scene.folder) / likelihoods), to);
    return absl::OkStatus();
  }
  TESSERA_RETURN_IF_ERROR(EnsureFolder(to.string()));
  const int classes = static_cast<int>(scene.classes.size());
  std::set<int> raised, others;
  for (int c = 0; c < classes; ++c) {
    const std::string& called = scene.classes[c].name;
    (called == "roof" || called == "building" || called == "vegetation" ? raised : others).insert(c);
  }
  TriangleMesh start;
  if (rung.kind == "start") {
    TESSERA_ASSIGN_OR_RETURN(start, LoadSceneMesh(scene, 0));
    if (start.labels.empty()) return absl::NotFoundError(scene.folder + ": the start mesh has no labels");
  }
  for (const SceneView& view : scene.views) {
    const fs::path image(view.name);
    const std::string stem = (image.parent_path() / image.stem()).string();
    LabelImage labels;
    if (rung.kind == "start") {
      if (view.lens.kind != LensModel::Kind::kPinhole) {
        return absl::UnimplementedError(scene.folder + ": distorted images have no rung 'start'");
      }
      labels = Rendered(start, view.camera);
    } else {
      const std::string path = absl::StrCat(scene.folder, "/truth/", stem, "_label.png");
      if (!fs::exists(path)) return absl::NotFoundError(path + " is missing");
      TESSERA_ASSIGN_OR_RETURN(labels, ReadLabelImage(path));
    }
    if (rung.kind == "grown") labels = Spread(labels, rung.pixels, raised);
    if (rung.kind == "shrunk") labels = Spread(labels, rung.pixels, others);
    for (uint8_t& label : labels.data) {
      if (rung.kind == "uniform") label = kUnknown;
      if (rung.kind == "permuted" && label != kUnknown) label = static_cast<uint8_t>((label + 1) % classes);
    }
    const std::string path = absl::StrCat(to.string(), "/", stem, ".png");
    TESSERA_RETURN_IF_ERROR(EnsureFolder(fs::path(path).parent_path().string()));
    TESSERA_RETURN_IF_ERROR(WritePng(path, labels));
  }
  return absl::OkStatus();
}

}  // namespace tessera
