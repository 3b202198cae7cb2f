#include "worker/changes/ground_match.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tessera {
namespace {

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
// Deviation of luminance that counts as noise: windows with less than this agree with nothing.
constexpr float kNoise = 0.012f;
// So many pairs, the best, speak for a window; the others may look at something in between.
constexpr int kBest = 4;
constexpr float kNoPair = -2;

// Luminance at pixel coordinates (centres at +0.5), bilinear; NaN outside.
float Bilinear(const FloatImage& image, float x, float y) {
  const float px = x - 0.5f, py = y - 0.5f;
  if (!(px >= 0 && py >= 0 && px < static_cast<float>(image.width - 1) && py < static_cast<float>(image.height - 1))) {
    return kNone;
  }
  const int ix = static_cast<int>(px), iy = static_cast<int>(py);
  const float fx = px - static_cast<float>(ix), fy = py - static_cast<float>(iy);
  const float* top = &image.data[static_cast<size_t>(iy) * image.width + ix];
  const float* bottom = top + image.width;
  const float upper = top[0] + fx * (top[1] - top[0]), lower = bottom[0] + fx * (bottom[1] - bottom[0]);
  return upper + fy * (lower - upper);
}

}  // namespace

int SampleGrid::rim() const {
  const int beyond = (window_samples - samples_per_cell + 1) / 2;
  return beyond <= 0 ? 0 : (beyond + samples_per_cell - 1) / samples_per_cell;
}

GroundMatcher::GroundMatcher(const SampleGrid& grid, const GroundPlane& ground, std::span<const ChangeView> views,
                             const ViewChoice& choice)
    : grid_(grid), ground_(ground), views_(views), choice_(choice) {
  luminance_.assign(choice.views.size(), std::vector<float>(static_cast<size_t>(grid.rows()) * grid.columns()));
}

template <class Height>
void GroundMatcher::Sample(const Height& height) {
  const int columns = grid_.columns(), rows = grid_.rows(), step = grid_.samples_per_cell, cells = columns / step;
  const Eigen::Vector3d up = ground_.axis_x.cross(ground_.axis_y);
  for (size_t v = 0; v < choice_.views.size(); ++v) {
    const ChangeView& view = views_[choice_.views[v]];
    const PinholeCamera& k = view.camera.intrinsics;
    // (u w, v w, w) = start + column · across + height · lift, exact in double to a part of a block, then float.
    Eigen::Matrix3d calibration;
    calibration << k.fx, 0, k.cx - view.x0, 0, k.fy, k.cy - view.y0, 0, 0, 1;
    const Eigen::Matrix3d from_world = calibration * view.camera.rotation_cam_from_world;
    const Eigen::Vector3d shift = calibration * view.camera.translation_cam_from_world;
    const Eigen::Vector3f across = (from_world * ground_.axis_x * grid_.spacing_m()).cast<float>();
    const Eigen::Vector3d lift = from_world * up;
    for (int j = 0; j < rows; ++j) {
      const Eigen::Vector3d row_start =
          from_world * (ground_.axis_x * grid_.X_m(0) + ground_.axis_y * grid_.Y_m(j)) + shift;
      float* out = &luminance_[v][static_cast<size_t>(j) * columns];
      for (int i = 0; i < step; ++i) {
        for (int c = 0; c < cells; ++c) {
          const int column = c * step + i;
          const Eigen::Vector3f p = height(row_start, lift, across, j, column);
          out[i * cells + c] = p.z() > 0 ? Bilinear(view.luminance, p.x() / p.z(), p.y() / p.z()) : kNone;
        }
      }
    }
  }
}

void GroundMatcher::Correlate(std::vector<float>* scores) {
  const int columns = grid_.columns(), step = grid_.samples_per_cell, cells = columns / step, rim = grid_.rim();
  const int width = grid_.width(), window = grid_.window_samples, first = rim * step - (window - step + 1) / 2;
  const float count = static_cast<float>(window) * static_cast<float>(window), floor = count * kNoise * kNoise;
  scores->assign(static_cast<size_t>(width) * grid_.height(), kNone);
  const size_t views = choice_.views.size();
  std::vector<std::vector<float>> mean(views, std::vector<float>(width)), inverse(mean);
  std::vector<float> product(width);
  std::vector<std::vector<float>> best(kBest, std::vector<float>(width));
  // Where the samples of window column o of all cells begin in a row.
  const auto column_at = [&](int o) { return ((first + o) % step) * cells + (first + o) / step; };
  for (int y = 0; y < grid_.height(); ++y) {
    const int first_row = y * step + first;
    for (size_t v = 0; v < views; ++v) {
      std::fill(product.begin(), product.end(), 0.0f);
      std::fill(mean[v].begin(), mean[v].end(), 0.0f);
      for (int r = 0; r < window; ++r) {
        for (int o = 0; o < window; ++o) {
          const float* a = &luminance_[v][static_cast<size_t>(first_row + r) * columns + column_at(o)];
          for (int x = 0; x < width; ++x) {
            mean[v][x] += a[x];
            product[x] += a[x] * a[x];
          }
        }
      }
      for (int x = 0; x < width; ++x) {
        inverse[v][x] = 1 / std::sqrt(std::max(product[x] - mean[v][x] * mean[v][x] / count, 0.0f) + floor);
        mean[v][x] /= count;
        // max() drops NaN.
        if (std::isnan(mean[v][x])) inverse[v][x] = kNone;
      }
    }
    for (auto& row : best) std::fill(row.begin(), row.end(), kNoPair);
    for (const auto& [i, j] : choice_.pairs) {
      std::fill(product.begin(), product.end(), 0.0f);
      for (int r = 0; r < window; ++r) {
        for (int o = 0; o < window; ++o) {
          const size_t at = static_cast<size_t>(first_row + r) * columns + column_at(o);
          const float *a = &luminance_[i][at], *b = &luminance_[j][at];
          for (int x = 0; x < width; ++x) product[x] += a[x] * b[x];
        }
      }
      for (int x = 0; x < width; ++x) {
        const float score = (product[x] - count * mean[i][x] * mean[j][x]) * inverse[i][x] * inverse[j][x];
        float passed = score >= kNoPair ? score : kNoPair;  // NaN: one of the two does not show the window
        for (int k = 0; k < kBest; ++k) {
          const float kept = std::max(best[k][x], passed);
          passed = std::min(best[k][x], passed);
          best[k][x] = kept;
        }
      }
    }
    float* out = scores->data() + static_cast<size_t>(y) * width;
    for (int x = 0; x < width; ++x) {
      float sum = 0, pairs = 0;
      for (int k = 0; k < kBest; ++k) {
        if (best[k][x] == kNoPair) continue;
        sum += best[k][x];
        pairs += 1;
      }
      if (pairs > 0) out[x] = sum / pairs;
    }
  }
}

void GroundMatcher::MatchPlane(double height_m, std::vector<float>* scores) {
  Sample([height_m](const Eigen::Vector3d& start, const Eigen::Vector3d& lift, const Eigen::Vector3f& across, int,
                    int column) -> Eigen::Vector3f {
    return (start + lift * height_m).cast<float>() + across * static_cast<float>(column);
  });
  Correlate(scores);
}

void GroundMatcher::MatchSurface(std::span<const float> heights_m, std::vector<float>* scores) {
  const int columns = grid_.columns();
  Sample([&](const Eigen::Vector3d& start, const Eigen::Vector3d& lift, const Eigen::Vector3f& across, int row,
             int column) -> Eigen::Vector3f {
    const float h = heights_m[static_cast<size_t>(row) * columns + column];
    return (start + lift * static_cast<double>(h)).cast<float>() + across * static_cast<float>(column);
  });
  Correlate(scores);
}

}  // namespace tessera
