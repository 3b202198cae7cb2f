#include "worker/refine/contour_term.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace tessera {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Of a pixel of contour: likelihoods go from one class to the other over about two pixels.
constexpr double kCurvaturePerPx2 = 0.5;

// One view's contours.
class ContourView {
 public:
  ContourView(const TriangleMesh& mesh, const std::vector<int32_t>& labels, const PhotoView& view, const FaceMap& map,
              const ContourOptions& options)
      : mesh_(mesh),
        labels_(labels),
        view_(view),
        map_(map),
        options_(options),
        gap_(static_cast<float>(options.gap_px / view.camera.intrinsics.fx)),
        centre_(view.camera.Centre()) {}

  std::vector<ContourPull> Pulls() {
    for (int y = 0; y < map_.height; ++y) {
      for (int x = 0; x < map_.width; ++x) {
        if (x + 1 < map_.width) AddSide(x, y, x + 1, y);
        if (y + 1 < map_.height) AddSide(x, y, x, y + 1);
      }
    }
    return std::move(pulls_);
  }

 private:
  size_t Index(int x, int y) const { return static_cast<size_t>(y) * map_.width + x; }
  Vector3d Ray(int x, int y) const { return view_.camera.Ray(map_.x0 + x + 0.5, map_.y0 + y + 0.5); }
  // Silhouettes are no comparison of pixels, so blind ones serve too.
  int32_t FaceAt(size_t pixel) const {
    const int32_t face = map_.face[pixel];
    return face < -1 && face != kNotLookedAt ? Blinded(face) : face;
  }
  int LabelAt(size_t pixel) const {
    const int32_t face = FaceAt(pixel);
    return face >= 0 && labels_[face] < view_.texels.classes ? labels_[face] : -1;
  }

  void AddSide(int x0, int y0, int x1, int y1) {
    const size_t p = Index(x0, y0), q = Index(x1, y1);
    const float nearer = std::min(map_.depth[p], map_.depth[q]), farther = std::max(map_.depth[p], map_.depth[q]);
    if (farther - nearer <= gap_ * nearer) return;
    const int a = LabelAt(p), b = LabelAt(q);
    if (a < 0 || b < 0 || a == b) return;
    if (map_.depth[p] == nearer) {
      AddContour(x0, y0, x1, y1, a, b);
    } else {
      AddContour(x1, y1, x0, y0, b, a);
    }
  }

  // (x, y) is on the nearer face, (bx, by) behind it.
  void AddContour(int x, int y, int bx, int by, int front, int behind) {
    const int32_t face = FaceAt(Index(x, y));
    const auto corner = [&](int c) { return mesh_.Corner(face, c); };
    const Vector3d normal = (corner(1) - corner(0)).cross(corner(2) - corner(0));
    const Vector3d ray = Ray(x, y);
    const double along = normal.dot(ray);
    if (along == 0) return;
    const Vector3d point = centre_ + normal.dot(corner(0) - centre_) / along * ray;
    const Vector3d way = centre_ + map_.depth[Index(bx, by)] * Ray(bx, by) - point;
    if ((way - options_.up.dot(way) * options_.up).squaredNorm() > options_.reach_m * options_.reach_m) return;
    const double gain = 0.5 * (view_.texels.Likelihood(x, y, front) - view_.texels.Likelihood(x, y, behind) +
                               view_.texels.Likelihood(bx, by, front) - view_.texels.Likelihood(bx, by, behind));
    // How far outward the contour goes in the image, pixels, when the point moves a metre.
    const PinholeCamera& k = view_.camera.intrinsics;
    const Vector3d seen = view_.camera.CameraFromWorld(point);
    const double right = k.fx * (bx - x) / seen.z(), down = k.fy * (by - y) / seen.z();
    const Vector3d outward = view_.camera.rotation_cam_from_world.transpose() *
                             Vector3d(right, down, -(right * seen.x() + down * seen.y()) / seen.z());
    const double area2 = normal.squaredNorm();
    for (int c = 0; c < 3; ++c) {
      const Vector3d opposite = (corner((c + 2) % 3) - corner((c + 1) % 3)).cross(point - corner((c + 1) % 3));
      const double share = std::clamp(opposite.dot(normal) / area2, 0.0, 1.0);
      if (share == 0) continue;
      pulls_.push_back({mesh_.faces[face][c], (-options_.weight * share * gain * outward).cast<float>(),
                        (std::sqrt(options_.weight * kCurvaturePerPx2 * share) * outward).cast<float>()});
    }
  }

  const TriangleMesh& mesh_;
  const std::vector<int32_t>& labels_;
  const PhotoView& view_;
  const FaceMap& map_;
  const ContourOptions& options_;
  const float gap_;  // of depth, relative to the nearer one
  const Vector3d centre_;
  std::vector<ContourPull> pulls_;
};

}  // namespace

std::vector<ContourPull> ContourPulls(const TriangleMesh& mesh, const std::vector<int32_t>& labels,
                                      const PhotoView& view, const FaceMap& map, const ContourOptions& options) {
  if (view.texels.classes == 0) return {};
  return ContourView(mesh, labels, view, map, options).Pulls();
}

void AddContourPulls(const std::vector<std::vector<ContourPull>>& pulls, std::vector<Vector3d>* gradient,
                     std::vector<Matrix3d>* curvature) {
  std::vector<uint16_t> seen(gradient->size(), 0);  // views
  std::vector<int32_t> last(gradient->size(), -1);
  for (size_t v = 0; v < pulls.size(); ++v) {
    for (const ContourPull& pull : pulls[v]) {
      if (last[pull.vertex] != static_cast<int32_t>(v)) ++seen[pull.vertex];
      last[pull.vertex] = static_cast<int32_t>(v);
    }
  }
  for (const std::vector<ContourPull>& view : pulls) {
    for (const ContourPull& pull : view) {
      const double scale = 1.0 / seen[pull.vertex];
      (*gradient)[pull.vertex] += scale * pull.gradient.cast<double>();
      const Vector3d root = pull.root_curvature.cast<double>();
      (*curvature)[pull.vertex] += scale * root * root.transpose();
    }
  }
}

}  // namespace tessera
