#include <filesystem>

#include "common/synth/synth.h"
#include "gtest/gtest.h"
#include "tests/support/bent_scene/bent_scene.h"
#include "tests/support/bent_scene/text_model.h"

namespace tessera::bent {
namespace {

namespace fs = std::filesystem;

// Of this process alone; removed when it ends.
struct BaseFolder {
  std::string path = testing::TempDir() + "bent_base";
  BaseFolder() {
    fs::remove_all(path);
    SynthOptions options;
    options.columns = options.rows = 1;
    options.seed = 3;
    options.gsd_m = 0.3;
    options.image_width_px = 400;
    options.image_height_px = 300;
    const auto report = SynthesizeCity(options, path, {});
    if (!report.ok()) FailBend(std::string(report.status().message()));
  }
  ~BaseFolder() {
    std::error_code ignored;
    fs::remove_all(path, ignored);
  }
};

}  // namespace

const std::string& BaseScene() {
  static const BaseFolder base;
  return base.path;
}

void CopyBaseScene(const std::string& scene) {
  fs::create_directories(fs::path(scene).parent_path());
  fs::create_directory(scene);
  for (const char* part : {"colmap", "images", "likelihoods", "mesh.ply", "scene.json"}) {
    fs::copy(BaseScene() + "/" + part, scene + "/" + part, fs::copy_options::recursive);
  }
}

}  // namespace tessera::bent
