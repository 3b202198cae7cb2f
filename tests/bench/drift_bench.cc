// How far updates drift: a city, then flight after flight over it though nothing changed, each an update of the one
// before; beside it one job with all images:
//   drift_bench FOLDER --updates 5
// Runs `tessera` from its own folder; all scenes and results stay in FOLDER.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/evaluate/evaluator.h"
#include "common/geometry/nearest_surface.h"
#include "common/imaging/image_io.h"
#include "common/meshio/mesh_format.h"
#include "common/scene/scene.h"
#include "common/storage/files.h"
#include "server/client/child_process.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

struct Arguments {
  std::string folder, blocks = "2x2", gsd = "0.25", image_size = "480x360", part = "0,0,1,1", epochs = "newest";
  int updates = 5;
};

constexpr double kRimGsd = 30;

class DriftBench {
 public:
  explicit DriftBench(const Arguments& arguments) : arguments_(arguments) {}

  Status Run() {
    TESSERA_ASSIGN_OR_RETURN(program_, ProgramFolder());
    fs::create_directories(arguments_.folder);
    const std::string base = Path("base");
    TESSERA_RETURN_IF_ERROR(Tessera({"synth", base, "--blocks", arguments_.blocks, "--gsd", arguments_.gsd,
                                     "--image-size", arguments_.image_size, "--quiet"}));
    TESSERA_RETURN_IF_ERROR(Tessera({"run", base, "--tiles", "4", "--out", Path("out0")}));
    TESSERA_ASSIGN_OR_RETURN(scene_, LoadScene(base, nullptr));
    TESSERA_ASSIGN_OR_RETURN(TriangleMesh truth, Mesh(base + "/truth"));
    EvaluationOptions options;
    options.up_in_local = scene_.up_in_local;
    TESSERA_ASSIGN_OR_RETURN(const double gsd_m, MedianGsd(scene_, truth));
    options.rim_m = kRimGsd * gsd_m;
    const TruthLabelSource labels = [&](size_t view) {
      return ReadLabelImage(
          absl::StrCat(base, "/truth/", fs::path(scene_.views[view].name).stem().string(), "_label.png"));
    };
    TESSERA_ASSIGN_OR_RETURN(
        const Evaluator evaluator,
        Evaluator::Create(std::move(truth), scene_.views, static_cast<int>(scene_.classes.size()), labels, options));
    TESSERA_ASSIGN_OR_RETURN(first_, Mesh(Path("out0")));
    surface_.emplace(first_);
    std::printf("GSD %.3f m; %d flights over %s of the extent, nothing changed, --epochs %s\n", gsd_m,
                arguments_.updates, arguments_.part.c_str(), arguments_.epochs.c_str());
    std::printf("%-10s %6s %6s %8s %8s %8s %8s %6s %10s %10s %6s\n", "", "tiles", "moved", "mean off", "rms off",
                "rms off", "rms of", "areas", "accuracy", "complete", "labels");
    std::printf("%-10s %6s %6s %8s %8s %8s %8s %6s %10s %10s %6s\n", "", "redone", "share", "base", "base", "surface",
                "step", "", "mean", "mean", "OA");
    TESSERA_RETURN_IF_ERROR(Print("base", "out0", evaluator));
    for (int k = 1; k <= arguments_.updates; ++k) {
      TESSERA_RETURN_IF_ERROR(MakeFlight(k));
      const std::string out = absl::StrCat("out", k);
      TESSERA_RETURN_IF_ERROR(
          Tessera({"run", Path(absl::StrCat("flight", k)), "--base", Path(absl::StrCat("out", k - 1)), "--epochs",
                   arguments_.epochs, "--out", Path(out)}));
      TESSERA_RETURN_IF_ERROR(Print(absl::StrCat("update ", k), out, evaluator));
    }
    // All images from the start mesh: what the last update would be if nothing had been refined before.
    TESSERA_RETURN_IF_ERROR(Tessera({"run", Path(absl::StrCat("flight", arguments_.updates)), "--base",
                                     Path(absl::StrCat("out", arguments_.updates - 1)), "--epochs", "all",
                                     "--from-scratch", "--out", Path("all")}));
    return Print("all images", "all", evaluator);
  }

 private:
  std::string Path(const std::string& name) const { return absl::StrCat(arguments_.folder, "/", name); }

  Status Tessera(const std::vector<std::string>& words) const {
    std::string command = absl::StrCat("'", program_, "/tessera'");
    for (const std::string& word : words) absl::StrAppend(&command, " '", word, "'");
    absl::StrAppend(&command, " >> '", Path("log"), "' 2>&1");
    if (std::system(command.c_str()) == 0) return absl::OkStatus();
    return absl::InternalError(absl::StrCat(command, " failed"));
  }

  // A flight of a year of its own.
  Status MakeFlight(int k) const {
    const std::string folder = Path(absl::StrCat("flight", k));
    TESSERA_RETURN_IF_ERROR(Tessera({"synth", folder, "--change", Path("base"), "--unchanged", "--part",
                                     arguments_.part, "--change-seed", std::to_string(k), "--quiet"}));
    TESSERA_ASSIGN_OR_RETURN(const std::string text, ReadFile(folder + "/scene.json"));
    json scene = json::parse(text);
    scene["flights"][0]["name"] = absl::StrCat("flight ", k);
    scene["flights"][0]["date"] = absl::StrFormat("%d-05-14", 2026 + k);
    return WriteFileAtomic(folder + "/scene.json", scene.dump());
  }

  StatusOr<TriangleMesh> Mesh(const std::string& folder) const {
    TESSERA_ASSIGN_OR_RETURN(MeshContent content, ReadMesh(folder + "/mesh.ply"));
    for (Eigen::Vector3d& v : content.mesh.vertices) v = scene_.frame.LocalFromScene(v);
    return std::move(content.mesh);
  }

  Status Print(const std::string& name, const std::string& out, const Evaluator& evaluator) {
    TESSERA_ASSIGN_OR_RETURN(const TriangleMesh mesh, Mesh(Path(out)));
    // The same faces, but for edges that were flipped.
    if (mesh.vertices.size() != first_.vertices.size() || mesh.faces.size() != first_.faces.size()) {
      return absl::InternalError(out + ": has other faces than the base");
    }
    size_t moved = 0;
    double sum_m = 0, square_m2 = 0, surface_m2 = 0, step_m2 = 0;
    for (size_t v = 0; v < mesh.vertices.size(); ++v) {
      const double way_m = (mesh.vertices[v] - first_.vertices[v]).norm();
      moved += way_m > 0;  // those of tiles that were redone
      sum_m += way_m;
      square_m2 += way_m * way_m;
      if (way_m > 0) surface_m2 += std::pow(surface_->Find(mesh.vertices[v]).distance_m, 2);
      if (!last_.empty()) step_m2 += (mesh.vertices[v] - last_[v]).squaredNorm();
    }
    const double count = std::max<double>(1, static_cast<double>(moved));
    json update, changes;
    if (const auto text = ReadFile(Path(out) + "/update.json"); text.ok()) update = json::parse(*text);
    if (const auto text = ReadFile(Path(out) + "/changes.json"); text.ok()) changes = json::parse(*text);
    TESSERA_ASSIGN_OR_RETURN(const Evaluation evaluation, evaluator.Evaluate(mesh));
    std::printf("%-10s %6s %6.3f %8.4f %8.4f %8.4f %8.4f %6s %10.4f %10.4f %6.3f\n", name.c_str(),
                update.empty() ? "-" : update["tiles_redone"].dump().c_str(),
                static_cast<double>(moved) / static_cast<double>(mesh.vertices.size()), sum_m / count,
                std::sqrt(square_m2 / count), std::sqrt(surface_m2 / count), std::sqrt(step_m2 / count),
                changes.empty() ? "-" : std::to_string(changes["areas"].size()).c_str(),
                evaluation.surface.accuracy.capped_mean_m, evaluation.surface.completeness.capped_mean_m,
                evaluation.labels_by_pixels ? evaluation.labels_by_pixels->scores.overall_accuracy : 0);
    if (!changes.empty()) std::printf("%-10s disagreement %s\n", "", changes["disagreement"].dump().c_str());
    std::fflush(stdout);
    last_ = mesh.vertices;
    return absl::OkStatus();
  }

  const Arguments& arguments_;
  std::string program_;
  SceneDescription scene_;
  TriangleMesh first_;  // the base's result
  std::optional<NearestSurface> surface_;
  std::vector<Eigen::Vector3d> last_;  // of the mesh printed last
};

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) {
  CLI::App app("How far updates drift from the first result where nothing changes");
  tessera::Arguments a;
  app.add_option("folder", a.folder, "for scenes and results; must not have any")->required();
  app.add_option("--updates", a.updates)->capture_default_str();
  app.add_option("--blocks", a.blocks)->capture_default_str();
  app.add_option("--gsd", a.gsd)->capture_default_str();
  app.add_option("--image-size", a.image_size)->capture_default_str();
  app.add_option("--part", a.part, "that each flight sees")->capture_default_str();
  app.add_option("--epochs", a.epochs, "of the updates: newest or all")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  const tessera::Status status = tessera::DriftBench(a).Run();
  if (!status.ok()) std::fprintf(stderr, "drift_bench: %s\n", status.ToString().c_str());
  return status.ok() ? 0 : 1;
}
