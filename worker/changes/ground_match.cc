#include "worker/changes/ground_match.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tessera {
namespace {

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
// Standard deviation of luminance below which a window counts as noise and agrees with nothing.
constexpr float kNoise = 0.012f;
// Only the best pairs that show a window are averaged: this share of them, within the limits below. Other pairs may
// see an occluder. More pairs require more agreement, since some agree by chance.
constexpr float kBestPairShare = 0.45f;
constexpr int kLeast = 3, kBest = 8;
constexpr float kNoPair = -2;
constexpr float kDoubt = 0.6f;
constexpr int kLane = 16;  // cells processed together

// Luminance at pixel coordinates (centres at +0.5), bilinear; NaN outside the image.
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

int SampleGrid::margin_cells() const {
  const int beyond = (window_samples - samples_per_cell + 1) / 2;
  return beyond <= 0 ? 0 : (beyond + samples_per_cell - 1) / samples_per_cell;
}

GroundMatcher::GroundMatcher(const SampleGrid& grid, const GroundPlane& ground, std::span<const ChangeView> views,
                             const ViewChoice& choice)
    : grid_(grid), ground_(ground), views_(views), choice_(choice) {
  luminance_.assign(choice.views.size(), std::vector<float>(static_cast<size_t>(grid.rows()) * grid.columns() + kLane));
}

template <class Height>
void GroundMatcher::Sample(const Height& height) {
  const int columns = grid_.columns(), rows = grid_.rows(), step = grid_.samples_per_cell, cells = columns / step;
  const Eigen::Vector3d up = ground_.axis_x.cross(ground_.axis_y);
  for (size_t v = 0; v < choice_.views.size(); ++v) {
    const ChangeView& view = views_[choice_.views[v]];
    const PinholeCamera& k = view.camera.intrinsics;
    // (u w, v w, w) = start + column · across + height · lift: in double per part of a block, then in float.
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

// Sums over the windows of kLane adjacent cells, from `first_cell` on.
template <class Term>
void GroundMatcher::SumWindows(int first_row, int first_cell, const Term& term) const {
  const int step = grid_.samples_per_cell, columns = grid_.columns(), cells = columns / step;
  const int first = FirstOfWindow();
  for (int r = 0; r < grid_.window_samples; ++r) {
    for (int o = 0; o < grid_.window_samples; ++o) {
      const int phase = (first + o) % step, shift = (first + o) / step;
      term(static_cast<size_t>(first_row + r) * columns + static_cast<size_t>(phase) * cells + shift + first_cell);
    }
  }
}

int GroundMatcher::FirstOfWindow() const {
  return grid_.margin_cells() * grid_.samples_per_cell - (grid_.window_samples - grid_.samples_per_cell + 1) / 2;
}

void GroundMatcher::Correlate(std::vector<float>* scores) {
  const int width = grid_.width(), step = grid_.samples_per_cell, window = grid_.window_samples;
  const float count = static_cast<float>(window) * static_cast<float>(window), floor = count * kNoise * kNoise;
  scores->assign(static_cast<size_t>(width) * grid_.height(), kNone);
  const size_t views = choice_.views.size();
  std::vector<std::array<float, kLane>> mean(views), inverse(views);
  std::vector<uint8_t> shown(views);
  for (int y = 0; y < grid_.height(); ++y) {
    const int first_row = y * step + FirstOfWindow();
    for (int first_cell = 0; first_cell < width; first_cell += kLane) {
      for (size_t v = 0; v < views; ++v) {
        float sum[kLane] = {}, squares[kLane] = {};
        SumWindows(first_row, first_cell, [&](size_t at) {
          const float* a = &luminance_[v][at];
          for (int x = 0; x < kLane; ++x) {
            sum[x] += a[x];
            squares[x] += a[x] * a[x];
          }
        });
        for (int x = 0; x < kLane; ++x) {
          mean[v][x] = sum[x] / count;
          // max() would drop NaN, which marks windows outside the view; the product below keeps it.
          inverse[v][x] = 1 / std::sqrt(std::max(squares[x] - sum[x] * mean[v][x], 0.0f) + floor);
        }
        shown[v] = std::any_of(sum, sum + kLane, [](float s) { return !std::isnan(s); });
      }
      float best[kBest][kLane], shown_pairs[kLane] = {};
      for (auto& row : best) std::fill(row, row + kLane, kNoPair);
      for (const auto& [i, j] : choice_.pairs) {
        if (!shown[i] || !shown[j]) continue;
        float product[kLane] = {};
        SumWindows(first_row, first_cell, [&](size_t at) {
          const float *a = &luminance_[i][at], *b = &luminance_[j][at];
          for (int x = 0; x < kLane; ++x) product[x] += a[x] * b[x];
        });
        for (int x = 0; x < kLane; ++x) {
          const float score = (product[x] - count * mean[i][x] * mean[j][x]) * inverse[i][x] * inverse[j][x];
          float passed = score >= kNoPair ? score : kNoPair;
          shown_pairs[x] += score >= kNoPair ? 1.0f : 0.0f;
          for (auto& row : best) {
            const float kept = std::max(row[x], passed);
            passed = std::min(row[x], passed);
            row[x] = kept;
          }
        }
      }
      float* out = scores->data() + static_cast<size_t>(y) * width + first_cell;
      for (int x = 0; x < std::min(kLane, width - first_cell); ++x) {
        float sum = 0, pairs = 0;
        const float used_pairs = std::clamp(std::round(kBestPairShare * shown_pairs[x]), static_cast<float>(kLeast),
                                            static_cast<float>(kBest));
        for (const auto& row : best) {
          if (row[x] == kNoPair || pairs >= used_pairs) continue;
          sum += row[x];
          pairs += 1;
        }
        // One pair may agree by chance, so the mean is reduced if few pairs contribute.
        if (pairs > 0) out[x] = sum / (pairs + kDoubt);
      }
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
