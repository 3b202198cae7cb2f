#include "tests/bench/accuracy/left_out_view.h"

#include <algorithm>
#include <cmath>

#include "common/base/parallel.h"
#include "common/imaging/image_io.h"
#include "tests/support/draw_views.h"
#include "worker/photo/pairs.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

constexpr int kRadius_px = 3;
constexpr double kOcclusion_px = 4;  // slack of the depth test
constexpr double kMinSigma = 0.004;  // of luminance, in the left-out view: less is no texture
constexpr double kEpsilon = 1e-6;    // added to variances

float Bilinear(const FloatImage& image, double x, double y) {
  const double u = std::clamp(x - 0.5, 0.0, image.width - 1.001), v = std::clamp(y - 0.5, 0.0, image.height - 1.001);
  const int x0 = static_cast<int>(u), y0 = static_cast<int>(v);
  const float a = static_cast<float>(u - x0), b = static_cast<float>(v - y0);
  return (1 - b) * ((1 - a) * image.at(x0, y0) + a * image.at(x0 + 1, y0)) +
         b * ((1 - a) * image.at(x0, y0 + 1) + a * image.at(x0 + 1, y0 + 1));
}

// `image` as seen from `to` by way of the mesh; NaN where the mesh is not, or is hidden from `from`.
FloatImage Warp(const FaceMap& to_map, const PosedCamera& to, const FaceMap& from_map, const PosedCamera& from,
                const FloatImage& image) {
  FloatImage out(to_map.width, to_map.height, 1, std::nanf(""));
  const Eigen::Vector3d centre = to.Centre();
  ParallelFor(to_map.height, 16, [&](int64_t begin, int64_t end) {
    for (int y = static_cast<int>(begin); y < end; ++y) {
      for (int x = 0; x < to_map.width; ++x) {
        const size_t at = static_cast<size_t>(y) * to_map.width + x;
        if (to_map.face[at] < 0) continue;
        const Eigen::Vector3d p = from.Project(centre + to_map.depth[at] * to.Ray(x + 0.5, y + 0.5));
        if (!from.InImage(p)) continue;
        float farthest = 0;
        for (int k = 0; k < 4; ++k) {
          const int px = std::clamp(static_cast<int>(std::floor(p.x() - 0.5)) + k % 2, 0, from_map.width - 1);
          const int py = std::clamp(static_cast<int>(std::floor(p.y() - 0.5)) + k / 2, 0, from_map.height - 1);
          farthest = std::max(farthest, from_map.depth[static_cast<size_t>(py) * from_map.width + px]);
        }
        if (p.z() > farthest + kOcclusion_px * p.z() / from.intrinsics.fx) continue;
        out.at(x, y) = Bilinear(image, p.x(), p.y());
      }
    }
  });
  return out;
}

// ZNCC of the window around each pixel; NaN unless every pixel of it has both values and `a` has texture there.
FloatImage Zncc(const FloatImage& a, const FloatImage& b) {
  FloatImage out(a.width, a.height, 1, std::nanf(""));
  ParallelFor(a.height, 16, [&](int64_t begin, int64_t end) {
    for (int y = std::max<int>(begin, kRadius_px); y < std::min<int>(end, a.height - kRadius_px); ++y) {
      for (int x = kRadius_px; x < a.width - kRadius_px; ++x) {
        if (std::isnan(b.at(x, y))) continue;
        double sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0;
        for (int j = -kRadius_px; j <= kRadius_px; ++j) {
          const float* ra = &a.at(x - kRadius_px, y + j);
          const float* rb = &b.at(x - kRadius_px, y + j);
          for (int i = 0; i <= 2 * kRadius_px; ++i) {
            sa += ra[i];
            sb += rb[i];
            saa += ra[i] * ra[i];
            sbb += rb[i] * rb[i];
            sab += ra[i] * rb[i];
          }
        }
        const double n = (2 * kRadius_px + 1) * (2 * kRadius_px + 1);
        const double va = saa / n - sa * sa / (n * n), vb = sbb / n - sb * sb / (n * n);
        // NaN anywhere in the window comes out as NaN.
        if (!(va >= kMinSigma * kMinSigma) || std::isnan(vb)) continue;
        out.at(x, y) = static_cast<float>((sab / n - sa * sb / (n * n)) /
                                          std::sqrt((va + kEpsilon) * (std::max(vb, 0.0) + kEpsilon)));
      }
    }
  });
  return out;
}

}  // namespace

StatusOr<LeftOutScore> ScoreLeftOutView(const SceneDescription& scene, size_t left_out,
                                        const std::vector<const TriangleMesh*>& meshes) {
  std::vector<PosedCamera> cameras;
  for (const SceneView& view : scene.views) cameras.push_back(view.camera);
  const auto read = [&scene](size_t view) {
    return ReadLuminance(scene.folder + "/" + scene.views[view].image_path, scene.views[view].lens);
  };
  TESSERA_ASSIGN_OR_RETURN(const FloatImage reference, read(left_out));
  std::vector<FaceMap> reference_maps;
  for (const TriangleMesh* mesh : meshes) reference_maps.push_back(RasterizeFaces(*mesh, cameras[left_out]));
  LeftOutScore score;
  score.mean_zncc.assign(meshes.size(), 0.0);
  for (const ViewPair& pair : SelectPairs(*meshes.at(0), cameras, PairOptions())) {
    if (pair.reference != static_cast<int>(left_out)) continue;
    TESSERA_ASSIGN_OR_RETURN(const FloatImage other, read(pair.other));
    ++score.neighbours;
    std::vector<FloatImage> zncc;
    for (size_t m = 0; m < meshes.size(); ++m) {
      const FaceMap map = RasterizeFaces(*meshes[m], cameras[pair.other]);
      zncc.push_back(Zncc(reference, Warp(reference_maps[m], cameras[left_out], map, cameras[pair.other], other)));
    }
    for (size_t at = 0; at < reference.data.size(); ++at) {
      if (std::any_of(zncc.begin(), zncc.end(), [at](const FloatImage& z) { return std::isnan(z.data[at]); })) continue;
      ++score.pixels;
      for (size_t m = 0; m < meshes.size(); ++m) score.mean_zncc[m] += zncc[m].data[at];
    }
  }
  if (score.pixels == 0) return absl::FailedPreconditionError("no pixel of the left-out view can be compared");
  for (double& mean : score.mean_zncc) mean /= static_cast<double>(score.pixels);
  return score;
}

}  // namespace tessera
