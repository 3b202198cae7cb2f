// kernel_bench [--width 1400] [--repeat 5]: what one evaluation of the data term costs on one core, in nanoseconds of
// CPU a pixel and directed pair, on a scene made here: a plain scalar version, then ours for every instruction set this
// machine has, image only and with classes; and the stages.
#include <hwy/highway.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <limits>
#include <string>
#include <vector>

#include "common/base/parallel.h"
#include "tests/support/draw_views.h"
#include "tests/support/make_texels.h"
#include "tests/support/relief_scene.h"
#include "tests/unit/worker/photo/zncc_oracle.h"
#include "worker/photo/photo_term.h"

namespace tessera {
namespace {

double CpuSeconds() {
  timespec time;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

struct Scene {
  TriangleMesh mesh;
  std::vector<PosedCamera> cameras;
  std::vector<PhotoView> image, classes;
  std::vector<ViewPair> pairs;
  PhotoOptions options;

  Scene(int width, int class_count) {
    // Faces of about 12 square pixels over the whole image, a decimetre off the truth.
    mesh = HeightField(std::max(8, width / 5), 7, ReliefHeight);
    const TriangleMesh truth = mesh;
    Random random(1);
    for (Eigen::Vector3d& v : mesh.vertices) v.z() += 0.02 * random.Normal();
    cameras = ReliefCameras(width);
    for (size_t i = 0; i < cameras.size(); ++i) {
      const FloatImage luminance = Photograph(truth, cameras[i], 0.9 + 0.05 * static_cast<double>(i), 0.01, i);
      const FloatImage likelihoods = PhotographClasses(truth, cameras[i], class_count);
      image.push_back({cameras[i], MakeTexels(luminance)});
      classes.push_back({cameras[i], MakeTexels(luminance, likelihoods, ScaleToSize(luminance, likelihoods))});
      for (size_t j = 0; j < cameras.size(); ++j) {
        if (i != j) pairs.push_back({static_cast<int>(i), static_cast<int>(j)});
      }
    }
    options.window = MakeWindow(7, true);
  }
};

// Nanoseconds a pixel and directed pair.
struct Cost {
  double prepare = 0, kernel = 0, gather = 0;
  double all() const { return prepare + kernel + gather; }
  void Add(const Cost& other) {
    prepare += other.prepare;
    kernel += other.kernel;
    gather += other.gather;
  }
};

// Sums that no compiler may leave out.
struct Checks {
  double energy = 0;
  float gradient = 0;
};

// The stages of PhotoTerm::Evaluate without visibility, on this thread: of `repeat` runs the best.
Cost Measure(const Scene& scene, const std::vector<PhotoView>& views, float semantic, int repeat, Checks* checks) {
  constexpr int kRows = 64;
  std::vector<FaceMap> maps;
  std::vector<WarpTarget> targets(views.size());
  std::vector<std::vector<float>> offsets;
  for (const PhotoView& view : views) {
    maps.push_back(RasterizeFaces(scene.mesh, view.camera));
    offsets.emplace_back();
    for (size_t f = 0; f < scene.mesh.faces.size(); ++f) {
      const Eigen::Vector3d from = scene.mesh.Corner(f, 0) - view.camera.Centre();
      offsets.back().push_back(static_cast<float>(FaceNormal(scene.mesh, f).dot(from)));
    }
  }
  std::vector<FaceSums> sums(scene.mesh.faces.size());
  const MeshPart part = {{{0, static_cast<uint32_t>(scene.mesh.faces.size())}},
                         {{0, static_cast<uint32_t>(scene.mesh.vertices.size())}}};
  ReferenceStrip strip;
  ZnccScratch scratch;
  FaceSlots slots;
  FaceGatherer gatherer;
  const std::vector<uint8_t> all;  // faces are wanted
  Cost best;
  double pixels = 0;
  for (int k = 0; k < repeat; ++k) {
    pixels = 0;
    Cost run;
    for (size_t i = 0; i < views.size(); ++i) {
      const double begin_s = CpuSeconds();
      SetWarpTarget(views[i].texels, maps[i], {}, &targets[i]);
      run.Add({CpuSeconds() - begin_s, 0, 0});
    }
    for (size_t i = 0; i < views.size(); ++i) {
      const Texels& texels = views[i].texels;
      std::vector<ZnccPair> pairs;
      for (const ViewPair& pair : scene.pairs) {
        if (pair.reference != static_cast<int>(i)) continue;
        pairs.push_back(
            MakeZnccPair(views[i], views[pair.other].camera, targets[pair.other], scene.options.occlusion_px));
      }
      pixels += static_cast<double>(pairs.size()) * texels.width * texels.height;
      const int strips = (texels.height + kRows - 1) / kRows;
      gatherer.Begin(scene.mesh, part, views[i].camera, maps[i], all, strips, StripSums::kAtOnce, &sums);
      for (int s = 0; s < strips; ++s) {
        const double begin_s = CpuSeconds();
        strip.Reset(texels.width, texels.height, scene.options.window.radius, s * kRows,
                    std::min(texels.height, (s + 1) * kRows));
        FillStrip(views[i].camera.intrinsics, texels, maps[i], offsets[i].data(), &strip);
        SummarizeReference(texels, scene.options.window, &strip, &scratch);
        const double prepared_s = CpuSeconds();
        for (const ZnccPair& pair : pairs) {
          checks->energy += AccumulateZncc(pair, scene.options.window, semantic, &strip, &scratch).energy;
        }
        const double summed_s = CpuSeconds();
        gatherer.AddStrip(s, strip, &slots);
        const double gathered_s = CpuSeconds();
        run.Add({prepared_s - begin_s, summed_s - prepared_s, gathered_s - summed_s});
      }
      const double begin_s = CpuSeconds();
      gatherer.Finish();
      run.Add({0, 0, CpuSeconds() - begin_s});
      checks->gradient += sums[0].gradient[0];
    }
    if (k == 0 || run.all() < best.all()) best = run;
  }
  const double unit = 1e9 / pixels;
  return {unit * best.prepare, unit * best.kernel, unit * best.gather};
}

// The kernel's job in plain float loops, one pair, likewise.
double MeasureScalar(const Scene& scene, const std::vector<PhotoView>& views, float semantic, int repeat,
                     Checks* checks) {
  const FaceMap map = RasterizeFaces(scene.mesh, views[0].camera);
  WarpTarget target;
  SetWarpTarget(views[1].texels, RasterizeFaces(scene.mesh, views[1].camera), {}, &target);
  std::vector<float> offsets;
  for (size_t f = 0; f < scene.mesh.faces.size(); ++f) {
    const Eigen::Vector3d from = scene.mesh.Corner(f, 0) - views[0].camera.Centre();
    offsets.push_back(static_cast<float>(FaceNormal(scene.mesh, f).dot(from)));
  }
  const Texels& texels = views[0].texels;
  ReferenceStrip strip;
  strip.Reset(texels.width, texels.height, scene.options.window.radius, 0, texels.height);
  FillStrip(views[0].camera.intrinsics, texels, map, offsets.data(), &strip);
  const ZnccPair pair = MakeZnccPair(views[0], views[1].camera, target, scene.options.occlusion_px);
  ZnccOracle<float> oracle(pair, scene.options.window, semantic, strip);
  double best_s = std::numeric_limits<double>::infinity();
  for (int k = 0; k < repeat; ++k) {
    const double begin_s = CpuSeconds();
    oracle.Run();
    best_s = std::min(best_s, CpuSeconds() - begin_s);
  }
  checks->energy += oracle.sums.energy;
  return 1e9 * best_s / (static_cast<double>(texels.width) * texels.height);
}

void Bench(int width, int classes, int repeat, const std::string& only) {
  const Scene scene(width, classes);
  Checks checks;
  const double plain = MeasureScalar(scene, scene.image, 0, repeat, &checks);
  const double plain_classes = MeasureScalar(scene, scene.classes, 1, repeat, &checks);
  std::printf("%d x %d pixels, %zu views, %zu directed pairs, %zu faces; ns of CPU a pixel and directed pair\n",
              scene.image[0].texels.width, scene.image[0].texels.height, scene.image.size(), scene.pairs.size(),
              scene.mesh.faces.size());
  std::printf("%-8s %-18s %8s %8s %8s %8s %14s\n", "", "", "prepare", "kernel", "gather", "all", "plain/kernel");
  const auto row = [](const char* target, const std::string& what, const Cost& cost, double reference) {
    std::printf("%-8s %-18s %8.2f %8.2f %8.2f %8.2f %14.1f\n", target, what.c_str(), cost.prepare, cost.kernel,
                cost.gather, cost.all(), reference / cost.kernel);
  };
  const std::string with_classes = "image + " + std::to_string(classes) + " classes";
  row("plain", "image", {0, plain, 0}, plain);
  row("plain", with_classes, {0, plain_classes, 0}, plain_classes);
  const int64_t supported = hwy::SupportedTargets();
  for (const int64_t target : {HWY_AVX3, HWY_AVX2, HWY_SSE4, HWY_SCALAR}) {
    if ((supported & target) == 0 || (!only.empty() && only != hwy::TargetName(target))) continue;
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    row(hwy::TargetName(target), "image", Measure(scene, scene.image, 0, repeat, &checks), plain);
    row(hwy::TargetName(target), with_classes, Measure(scene, scene.classes, 1, repeat, &checks), plain_classes);
  }
  std::printf("(check: %.6g)\n", checks.energy + static_cast<double>(checks.gradient));
}

}  // namespace
}  // namespace tessera

int main(int argc, char** argv) {
  CLI::App app("What one evaluation of the data term costs on one core");
  int width = 1400, classes = 4, repeat = 5;
  app.add_option("--width", width, "of the images, pixels");
  app.add_option("--classes", classes, "number of classes in the runs with likelihoods");
  app.add_option("--repeat", repeat, "times, of which the best counts");
  std::string target;
  app.add_option("--target", target, "this instruction set alone: AVX3, AVX2, SSE4 or SCALAR");
  CLI11_PARSE(app, argc, argv);
  const tessera::ThreadLimit limit(1);
  tessera::Bench(width, classes, repeat, target);
  return 0;
}
