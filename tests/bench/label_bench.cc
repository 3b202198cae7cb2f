// How good the labels are that each part of the label step gives on a mesh that stays as it is:
//   label_bench --scene campus --mesh out/mesh.ply --mesh campus/mesh.ply
// prints for every mesh: each view's own argmax, plain sums of likelihoods over what each face shows, the whole field,
// the field without each of its terms, the paper's form, and the ceiling: the best that labels of whole faces can do,
// which knows the truth. With --expansion the energy is compared with CGAL's alpha expansion.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/evaluate/confusion.h"
#include "common/evaluate/label_rendering.h"
#include "common/geometry/edge_list.h"
#include "common/imaging/image_io.h"
#include "common/meshio/mesh_format.h"
#include "common/scene/scene.h"
#include "tests/support/alpha_expansion.h"
#include "tests/support/draw_views.h"
#include "tests/support/label_energy.h"
#include "worker/label/belief_propagation.h"
#include "worker/label/label_field.h"
#include "worker/label/unary.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

constexpr uint8_t kNoClass = 255;  // in a truth

struct Arguments {
  std::string scene, pictures;
  std::vector<std::string> meshes;
  LabelOptions label;
  SolverOptions solver;
  int threads = 0;
  bool expansion = false, halve = false, covered = false;
  std::vector<std::string> except_views;
};

// A view's truth and the classes that it would choose alone.
struct ScoredView {
  LabelImage truth, argmax;
  FloatImage likelihoods;
  PixelMapping mapping;
};

struct Score {
  ConfusionMatrix confusion;
  std::vector<double> error;  // a view: share of the truth's pixels that are wrong
};

double CpuSeconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

LabelImage Argmax(const FloatImage& likelihoods, const PixelMapping& mapping, int width, int height) {
  // One face a pixel makes the sums of faces those of pixels.
  FaceMap map{width, height, std::vector<int32_t>(static_cast<size_t>(width) * height), {}};
  for (size_t i = 0; i < map.face.size(); ++i) map.face[i] = static_cast<int32_t>(i);
  FaceLikelihoods sums(map.face.size(), likelihoods.channels);
  AddLikelihoods(map, likelihoods, mapping, &sums);
  LabelImage image(width, height);
  for (size_t i = 0; i < map.face.size(); ++i) {
    const float* sum = &sums.sum[i * sums.classes];
    image.data[i] = static_cast<uint8_t>(std::max_element(sum, sum + sums.classes) - sum);
  }
  return image;
}

StatusOr<std::vector<ScoredView>> LoadViews(const SceneDescription& scene, const std::vector<std::string>& except) {
  std::vector<ScoredView> views(scene.views.size());
  for (size_t v = 0; v < views.size(); ++v) {
    const SceneView& view = scene.views[v];
    const PinholeCamera& pinhole = view.camera.intrinsics;
    const fs::path name(view.name);
    const fs::path path = fs::path(scene.folder) / "truth" / name.parent_path() / (name.stem().string() + "_label.png");
    const bool scored = std::find(except.begin(), except.end(), name.stem().string()) == except.end();
    if (scored && fs::exists(path)) {
      TESSERA_ASSIGN_OR_RETURN(const LabelImage truth, ReadLabelImage(path.string()));
      views[v].truth = UndistortLabels(truth, view.lens);
    }
    if (view.likelihood_path.empty()) continue;
    TESSERA_ASSIGN_OR_RETURN(views[v].likelihoods, ReadLikelihoods(scene.folder + "/" + view.likelihood_path,
                                                                   static_cast<int>(scene.classes.size()), view.lens));
    views[v].mapping = {static_cast<double>(views[v].likelihoods.width) / pinhole.width,
                        static_cast<double>(views[v].likelihoods.height) / pinhole.height, 0, 0};
    views[v].argmax = Argmax(views[v].likelihoods, views[v].mapping, pinhole.width, pinhole.height);
  }
  return views;
}

// `label(view, pixel)`: class shown, or -1.
Score ScoreViews(const std::vector<ScoredView>& views, int classes,
                 const std::function<int(size_t view, size_t pixel)>& label) {
  Score score{ConfusionMatrix(classes), {}};
  for (size_t v = 0; v < views.size(); ++v) {
    if (views[v].truth.empty()) continue;
    ConfusionMatrix one(classes);
    for (size_t i = 0; i < views[v].truth.data.size(); ++i) {
      if (views[v].truth.data[i] < classes) one.Add(views[v].truth.data[i], label(v, i));
    }
    score.error.push_back(one.total() > 0 ? 1 - ScoreLabels(one).overall_accuracy : 0);
    score.confusion.Add(one);
  }
  return score;
}

void PrintHeader() { std::printf("%-30s|%7s%7s%7s|%9s%7s|%7s\n", "", "OA", "AA", "mIoU", "3D/2D", "worst", "CPU s"); }

void PrintScore(const std::string& name, const Score& score, const Score& alone, double cpu_s) {
  const LabelScores scores = ScoreLabels(score.confusion);
  std::vector<double> ratios;
  for (size_t v = 0; v < score.error.size(); ++v) {
    if (alone.error[v] > 0) ratios.push_back(score.error[v] / alone.error[v]);
  }
  std::sort(ratios.begin(), ratios.end());
  std::printf("%-30s|%7.4f%7.4f%7.4f|", name.c_str(), scores.overall_accuracy, scores.average_accuracy,
              scores.mean_iou);
  if (!ratios.empty()) std::printf("%9.3f%7.3f|", ratios[ratios.size() / 2], ratios.back());
  std::printf("%7.2f |", cpu_s);
  for (const ClassLabelScore& c : scores.classes) std::printf(" %.3f", c.recall);
  std::printf("\n");
  std::fflush(stdout);
}

std::vector<int32_t> LeastOf(const std::vector<float>& costs, int classes) {
  std::vector<int32_t> labels(costs.size() / classes);
  for (size_t f = 0; f < labels.size(); ++f) {
    const float* row = &costs[f * classes];
    labels[f] = static_cast<int32_t>(std::min_element(row, row + classes) - row);
  }
  return labels;
}

// The class that most of the truth's pixels have where the face shows.
std::vector<int32_t> CeilingLabels(const std::vector<ScoredView>& views, const std::vector<FaceMap>& maps, int classes,
                                   size_t faces) {
  std::vector<float> counts(faces * classes, 0);
  for (size_t v = 0; v < views.size(); ++v) {
    for (size_t i = 0; i < views[v].truth.data.size(); ++i) {
      const int32_t face = maps[v].face[i];
      if (face >= 0 && views[v].truth.data[i] < classes) counts[face * classes + views[v].truth.data[i]] -= 1;
    }
  }
  return LeastOf(counts, classes);
}

// Every face in four, edges halved. Face f becomes 4 f to 4 f + 3.
TriangleMesh Halved(const TriangleMesh& mesh) {
  TriangleMesh halved;
  halved.vertices = mesh.vertices;
  std::map<std::pair<uint32_t, uint32_t>, uint32_t> middles;
  const auto middle = [&](uint32_t a, uint32_t b) {
    const auto [at, made] = middles.try_emplace(std::minmax(a, b), static_cast<uint32_t>(halved.vertices.size()));
    if (made) halved.vertices.push_back(0.5 * (mesh.vertices[a] + mesh.vertices[b]));
    return at->second;
  };
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const auto& [a, b, c] = mesh.faces[f];
    const uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
    halved.faces.insert(halved.faces.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
    if (!mesh.labels.empty()) halved.labels.insert(halved.labels.end(), 4, mesh.labels[f]);
  }
  return halved;
}

// Grey by class, red where the mesh shows another class than the truth, orange where it shows nothing.
Status DrawErrors(const ScoredView& view, const FaceMap& map, const std::vector<int32_t>& labels, int classes,
                  const std::string& path) {
  ByteImage image(map.width, map.height, 3, 255);
  for (size_t i = 0; i < map.face.size(); ++i) {
    const int truth = view.truth.data[i];
    if (truth >= classes) continue;
    const bool nothing = map.face[i] < 0, wrong = nothing || labels[map.face[i]] != truth;
    const int grey = 230 - 120 * truth / std::max(1, classes - 1);
    image.plane(0)[i] = static_cast<uint8_t>(wrong ? 220 : grey);
    image.plane(1)[i] = static_cast<uint8_t>(nothing ? 140 : wrong ? 0 : grey);
    image.plane(2)[i] = static_cast<uint8_t>(wrong ? 0 : grey);
  }
  return WritePng(path, image);
}

FaceLikelihoods CollectLikelihoods(const std::vector<ScoredView>& views, const std::vector<FaceMap>& maps,
                                   const TriangleMesh& mesh, int classes) {
  FaceLikelihoods sums(mesh.faces.size(), classes);
  for (size_t v = 0; v < views.size(); ++v) {
    if (!views[v].likelihoods.empty()) AddLikelihoods(maps[v], views[v].likelihoods, views[v].mapping, &sums);
  }
  return sums;
}

// Squares of the ground that the faces' centroids lie in.
std::vector<Cell> CellsOf(const TriangleMesh& mesh, const Eigen::Vector3d& up, double gsd_m) {
  const Eigen::Vector3d x = up.unitOrthogonal(), y = up.cross(x);
  std::vector<Cell> cells;
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const Eigen::Vector3d centre =
        (mesh.Corner(f, 0) + mesh.Corner(f, 1) + mesh.Corner(f, 2)) / (3 * kLabelCellGsd * gsd_m);
    cells.push_back({static_cast<int32_t>(std::floor(centre.dot(x))), static_cast<int32_t>(std::floor(centre.dot(y)))});
  }
  return cells;
}

// How much of the area keeps its label when every face is split and all is solved again.
Status PrintAgreement(const SceneDescription& scene, const std::vector<ScoredView>& views,
                      const std::vector<CameraWindow>& cameras, const TriangleMesh& mesh,
                      const std::vector<int32_t>& labels, double gsd_m, const Arguments& arguments) {
  const TriangleMesh halved = Halved(mesh);
  std::vector<FaceMap> maps;
  Rasterizer rasterizer;
  DrawViews(halved, CellBoxes(halved), cameras, &rasterizer, &maps);
  const FaceLikelihoods sums = CollectLikelihoods(views, maps, halved, static_cast<int>(scene.classes.size()));
  LabelField field =
      BuildLabelField(halved, EdgeList(halved.faces), sums, scene.classes, scene.up_in_local, gsd_m, arguments.label);
  field.cell = CellsOf(halved, scene.up_in_local, gsd_m);
  const std::vector<int32_t> start(halved.faces.size(), -1);
  const std::vector<int32_t> split = SolveLabels(field, start, arguments.solver).labels;
  double same = 0, all = 0, same_seen = 0, seen = 0;
  for (size_t f = 0; f < split.size(); ++f) {
    const double area = FaceArea(halved, f);
    all += area;
    if (split[f] == labels[f / 4]) same += area;
    if (sums.pixels[f] == 0) continue;
    seen += area;
    if (split[f] == labels[f / 4]) same_seen += area;
  }
  std::printf("    every face split in four: %.3f %% of the area has the same label, %.3f %% of what is seen\n",
              100 * same / all, 100 * same_seen / seen);
  return absl::OkStatus();
}

Status BenchMesh(const SceneDescription& scene, std::vector<ScoredView> views, const std::string& path,
                 const Arguments& arguments) {
  TESSERA_ASSIGN_OR_RETURN(MeshContent content, ReadMesh(path));
  TriangleMesh& mesh = content.mesh;
  for (Eigen::Vector3d& p : mesh.vertices) p = scene.frame.LocalFromScene(p);
  TESSERA_ASSIGN_OR_RETURN(const double gsd_m, MedianGsd(scene, mesh));
  const std::vector<MeshEdge> edges = EdgeList(mesh.faces);
  const int classes = static_cast<int>(scene.classes.size());
  std::vector<CameraWindow> cameras;
  for (const SceneView& view : scene.views) cameras.push_back(view.camera);
  std::vector<FaceMap> maps;
  Rasterizer rasterizer;
  DrawViews(mesh, CellBoxes(mesh), cameras, &rasterizer, &maps);

  for (size_t v = 0; v < views.size() && arguments.covered; ++v) {
    for (size_t i = 0; i < views[v].truth.data.size(); ++i) {
      if (maps[v].face[i] < 0) views[v].truth.data[i] = kNoClass;
    }
  }

  std::printf("\n%s: %zu faces, GSD %.3f m\n", path.c_str(), mesh.faces.size(), gsd_m);
  PrintHeader();
  const Score alone = ScoreViews(views, classes, [&](size_t v, size_t i) {
    return views[v].argmax.empty() ? -1 : static_cast<int>(views[v].argmax.data[i]);
  });
  const auto print = [&](const std::string& name, const std::vector<int32_t>& labels, double cpu_s) {
    const Score score = ScoreViews(views, classes, [&](size_t v, size_t i) {
      const int32_t face = maps[v].face[i];
      return face < 0 ? -1 : labels[face];
    });
    PrintScore(name, score, alone, cpu_s);
  };
  PrintScore("each view's argmax", alone, alone, 0);
  if (!mesh.labels.empty()) print("labels of the file", mesh.labels, 0);

  double start_s = CpuSeconds();
  const FaceLikelihoods sums = CollectLikelihoods(views, maps, mesh, classes);
  std::vector<float> negated = sums.sum;
  for (float& x : negated) x = -x;
  print("plain sums", LeastOf(negated, classes), CpuSeconds() - start_s);

  const auto solve = [&](const std::string& name, const LabelOptions& options) -> std::vector<int32_t> {
    LabelField field = BuildLabelField(mesh, edges, sums, scene.classes, scene.up_in_local, gsd_m, options);
    field.cell = CellsOf(mesh, scene.up_in_local, gsd_m);
    const std::vector<int32_t> start = mesh.labels.empty() ? std::vector<int32_t>(mesh.faces.size(), -1) : mesh.labels;
    start_s = CpuSeconds();
    const Labelling solved = SolveLabels(field, start, arguments.solver);
    print(name, solved.labels, CpuSeconds() - start_s);
    if (!arguments.expansion) return solved.labels;
    const std::vector<int32_t> least = LeastOf(field.unary, classes);
    std::vector<int32_t> labelled = start;
    for (size_t f = 0; f < labelled.size(); ++f) {
      if (labelled[f] < 0) labelled[f] = least[f];
    }
    const double start_energy = LabelEnergy(field, labelled), energy = LabelEnergy(field, solved.labels);
    const double best = std::min(energy, LabelEnergy(field, ExpandLabels(field, solved.labels)));
    const double expanded = LabelEnergy(field, ExpandLabels(field, least));
    std::printf(
        "    energy: start %.1f, ours %.1f, expansion from the unary's best %.1f, from ours %.1f; gap %.4f %%\n",
        start_energy, energy, expanded, best,
        100 * (energy - std::min(best, expanded)) / (start_energy - std::min(best, expanded)));
    return solved.labels;
  };
  const std::vector<int32_t> labels = solve("field", arguments.label);
  if (arguments.halve) {
    TESSERA_RETURN_IF_ERROR(PrintAgreement(scene, views, cameras, mesh, labels, gsd_m, arguments));
  }
  for (size_t v = 0; v < views.size() && !arguments.pictures.empty(); ++v) {
    if (views[v].truth.empty()) continue;
    const std::string name =
        absl::StrCat(fs::path(path).stem().string(), "_", fs::path(scene.views[v].name).stem().string(), ".png");
    TESSERA_RETURN_IF_ERROR(
        DrawErrors(views[v], maps[v], labels, classes, absl::StrCat(arguments.pictures, "/", name)));
  }
  LabelOptions options = arguments.label;
  options.prior_weight = 0;
  solve("field without prior", options);
  options = arguments.label;
  options.smoothness_weight = 0;
  solve("field without Potts term", options);
  options = arguments.label;
  options.form = LabelOptions::Form::kPaper;
  options.smoothness_weight = 0.5;
  solve("paper's form", options);
  print("ceiling", CeilingLabels(views, maps, classes, mesh.faces.size()), 0);
  return absl::OkStatus();
}

Status Bench(const Arguments& arguments) {
  const ThreadLimit limit(arguments.threads);
  Warnings warnings;
  TESSERA_ASSIGN_OR_RETURN(const SceneDescription scene, LoadScene(arguments.scene, &warnings));
  for (const std::string& name : arguments.except_views) {
    const bool known = std::any_of(scene.views.begin(), scene.views.end(),
                                   [&](const SceneView& view) { return fs::path(view.name).stem() == name; });
    if (!known) return absl::InvalidArgumentError("--except-views: no view is called '" + name + "'");
  }
  TESSERA_ASSIGN_OR_RETURN(const std::vector<ScoredView> views, LoadViews(scene, arguments.except_views));
  for (const std::string& mesh : arguments.meshes) {
    TESSERA_RETURN_IF_ERROR(BenchMesh(scene, views, mesh, arguments));
  }
  return absl::OkStatus();
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) {
  CLI::App app("Labels by each part of the label step, on meshes that stay as they are");
  tessera::Arguments a;
  app.add_option("--scene", a.scene, "folder of a scene with likelihoods and a truth")->required();
  app.add_option("--mesh", a.meshes, "PLY in the scene's coordinates; may be given again")
      ->required()
      ->allow_extra_args(false);
  app.add_option("--prior", a.label.prior_weight, "mu1")->capture_default_str();
  app.add_option("--smoothness", a.label.smoothness_weight, "mu2")->capture_default_str();
  app.add_option("--unsure-pixels", a.label.unsure_pixels)->capture_default_str();
  app.add_flag("--expansion", a.expansion, "compare with alpha expansion (minutes)");
  app.add_option("--pictures", a.pictures,
                 "folder, there already, for a picture of each view with the errors of the field's labels in red");
  app.add_flag("--covered", a.covered, "score only pixels where the mesh shows something");
  app.add_option("--except-views", a.except_views, "views that are not scored, by their names without extension")
      ->delimiter(',');
  app.add_flag("--halve", a.halve, "also split every face in four: does the field give the same labels?");
  app.add_option("--threads", a.threads, "0: one for each core");
  CLI11_PARSE(app, argc, argv);
  const tessera::Status status = tessera::Bench(a);
  if (!status.ok()) std::fprintf(stderr, "label_bench: %s\n", status.ToString().c_str());
  return status.ok() ? 0 : 1;
}
