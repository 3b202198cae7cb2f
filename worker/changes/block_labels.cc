#include "worker/changes/block_labels.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tessera {

BlockLikelihoods::BlockLikelihoods(const CellRect& cells, const GroundPlane& ground, std::span<const ChangeView> views,
                                   const ViewChoice& choice, int classes)
    : cells_(cells), ground_(ground), views_(views), choice_(choice), classes_(classes) {}

bool BlockLikelihoods::At(const ChangeView& view, const Eigen::Vector3d& p, float* likelihoods) const {
  if (view.likelihoods.channels < classes_ || view.likelihoods.empty()) return false;
  const Eigen::Vector3d pixel = view.camera.Project(p);
  if (!view.camera.InImage(pixel)) return false;
  if (view.masked) {
    const int u = static_cast<int>(pixel.x()) - view.x0, v = static_cast<int>(pixel.y()) - view.y0;
    if (u < 0 || v < 0 || u >= view.luminance.width || v >= view.luminance.height) return false;
    if (std::isnan(view.luminance.at(u, v))) return false;
  }
  const PixelMapping& map = view.likelihood_at;
  const double x = map.scale_x * pixel.x() + map.offset_x - map.first_x;
  const double y = map.scale_y * pixel.y() + map.offset_y - map.first_y;
  if (!(x >= 0 && y >= 0 && x < view.likelihoods.width && y < view.likelihoods.height)) return false;
  for (int c = 0; c < classes_; ++c) {
    likelihoods[c] = view.likelihoods.at(static_cast<int>(x), static_cast<int>(y), c);
  }
  return true;
}

void BlockLikelihoods::Agreement(double height_m, std::vector<float>* agreement) const {
  const Eigen::Vector3d up = ground_.axis_x.cross(ground_.axis_y);
  const int width = cells_.x1 - cells_.x0, height = cells_.y1 - cells_.y0;
  agreement->assign(static_cast<size_t>(width) * height, std::numeric_limits<float>::quiet_NaN());
  std::vector<float> one(classes_), sum(classes_);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const Eigen::Vector3d p = ground_.axis_x * ((cells_.x0 + x + 0.5) * ground_.cell_m) +
                                ground_.axis_y * ((cells_.y0 + y + 0.5) * ground_.cell_m) + up * height_m;
      std::fill(sum.begin(), sum.end(), 0.0f);
      float squares = 0;
      int seen = 0;
      for (const int v : choice_.views) {
        if (!At(views_[v], p, one.data())) continue;
        ++seen;
        for (int c = 0; c < classes_; ++c) {
          sum[c] += one[c];
          squares += one[c] * one[c];
        }
      }
      if (seen < 2) continue;
      float all = 0;
      for (const float s : sum) all += s * s;
      (*agreement)[static_cast<size_t>(y) * width + x] = (all - squares) / static_cast<float>(seen * (seen - 1));
    }
  }
}

// Ray marching towards the camera, one cell per step, until above the highest surface.
bool BlockLikelihoods::Hidden(int x, int y, double height_m, const Eigen::Vector3d& to_camera,
                              std::span<const float> occluders_m, double top_m) const {
  const Eigen::Vector3d up = ground_.axis_x.cross(ground_.axis_y);
  const Eigen::Vector2d slope = ground_.Coordinates(to_camera) / up.dot(to_camera);
  const double cells_per_m = slope.norm() / ground_.cell_m;
  if (cells_per_m == 0) return false;
  const Eigen::Vector2d way = slope.normalized();
  const int width = cells_.x1 - cells_.x0, height = cells_.y1 - cells_.y0;
  for (int k = 1;; ++k) {
    const double ray_m = height_m + k / cells_per_m;
    const int cx = static_cast<int>(std::floor(x + 0.5 + k * way.x()));
    const int cy = static_cast<int>(std::floor(y + 0.5 + k * way.y()));
    if (ray_m > top_m || cx < 0 || cy < 0 || cx >= width || cy >= height) return false;
    if (occluders_m[static_cast<size_t>(cy) * width + cx] > ray_m + ground_.cell_m) return true;
  }
}

void BlockLikelihoods::Collect(std::span<const float> heights_m, std::span<const float> occluders_m,
                               std::vector<float>* sums, std::vector<int>* seen) const {
  const Eigen::Vector3d up = ground_.axis_x.cross(ground_.axis_y);
  const int width = cells_.x1 - cells_.x0, height = cells_.y1 - cells_.y0;
  sums->assign(heights_m.size() * classes_, 0.0f);
  seen->assign(heights_m.size(), 0);
  float top_m = -std::numeric_limits<float>::infinity();
  for (const float h : occluders_m) top_m = std::isnan(h) ? top_m : std::max(top_m, h);
  std::vector<float> one(classes_);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const size_t i = static_cast<size_t>(y) * width + x;
      const double own_m = heights_m[i];
      if (std::isnan(own_m)) continue;
      const Eigen::Vector3d p = ground_.axis_x * ((cells_.x0 + x + 0.5) * ground_.cell_m) +
                                ground_.axis_y * ((cells_.y0 + y + 0.5) * ground_.cell_m) + up * own_m;
      for (const int v : choice_.views) {
        const ChangeView& view = views_[v];
        const Eigen::Vector3d pixel = view.camera.Project(p);
        if (!view.camera.InImage(pixel)) continue;
        const int px = static_cast<int>(pixel.x()) - view.x0, py = static_cast<int>(pixel.y()) - view.y0;
        if (px < 0 || py < 0 || px >= view.luminance.width || py >= view.luminance.height) continue;
        if (Hidden(x, y, own_m, view.camera.Centre() - p, occluders_m, top_m)) continue;
        ++(*seen)[i];
        if (!At(view, p, one.data())) continue;
        for (int c = 0; c < classes_; ++c) (*sums)[i * classes_ + c] += one[c];
      }
    }
  }
}

}  // namespace tessera
