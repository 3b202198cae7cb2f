#include "common/classify/features.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

constexpr int kLevels = 4;                          // pyramid levels above the image
constexpr std::array<int, 2> kMeshLevels = {2, 4};  // levels at which mesh channels are averaged
constexpr int kChannels = 8;                        // of the image: see ImageChannels
constexpr int kMeshChannels = 5;                    // hit, normal, its square, height, its square
constexpr int kSingle = 4;                          // features of the single pixel
constexpr int kPerLevel = 8;                        // features per level
constexpr int kMeshSingle = 1 + 3 + 2 + 2;          // of MeshSurface::SurfaceHit
constexpr int kMeshPerLevel = 4;
constexpr float kMaxHeight_m = 60;  // heights are clamped to this range
using LevelPixel = cv::Vec<float, kPerLevel>;
using ChannelPixel = cv::Vec<float, kChannels>;
using MeshPixel = cv::Vec<float, kMeshChannels>;
using MeshLevelPixel = cv::Vec<float, kMeshPerLevel>;

float Deviation(float mean, float mean_square) { return std::sqrt(std::max(0.0f, mean_square - mean * mean)); }

// The unit direction of the projected up vector at a pixel: the image motion of a surface point that moves up. Zero if
// it does not move.
Eigen::Vector2f LiftedDirection(const Eigen::Vector3d& up_in_camera, double x, double y, const PinholeCamera& k) {
  const double u = (x - k.cx) / k.fx, v = (y - k.cy) / k.fy;
  Eigen::Vector2d d(k.fx * (up_in_camera.x() - u * up_in_camera.z()), k.fy * (up_in_camera.y() - v * up_in_camera.z()));
  const double length = d.norm();
  return length < 1e-6 * k.fx ? Eigen::Vector2f(0, 0) : Eigen::Vector2f((d / length).cast<float>());
}

// Bilinear interpolation of a plane at pixel indices (x, y), clamped to the plane.
template <class Pixel>
Pixel Bilinear(const cv::Mat& plane, float x, float y) {
  const float fx = std::clamp(x, 0.0f, static_cast<float>(plane.cols - 1));
  const float fy = std::clamp(y, 0.0f, static_cast<float>(plane.rows - 1));
  const int x0 = static_cast<int>(fx), y0 = static_cast<int>(fy);
  const int x1 = std::min(x0 + 1, plane.cols - 1), y1 = std::min(y0 + 1, plane.rows - 1);
  const float ax = fx - static_cast<float>(x0), ay = fy - static_cast<float>(y0);
  const Pixel* r0 = plane.ptr<Pixel>(y0);
  const Pixel* r1 = plane.ptr<Pixel>(y1);
  const float w00 = (1 - ax) * (1 - ay), w10 = ax * (1 - ay), w01 = (1 - ax) * ay, w11 = ax * ay;
  Pixel out;
  for (int c = 0; c < Pixel::channels; ++c) {
    out[c] = w00 * r0[x0][c] + w10 * r0[x1][c] + w01 * r1[x0][c] + w11 * r1[x1][c];
  }
  return out;
}

// Channels: lightness; excess green; red minus blue; squares of the first two; squares and product of the gradients
// along and across the projected up direction.
cv::Mat ImageChannels(const ByteImage& rgb, const SceneView& view, const Eigen::Vector3d& up) {
  const int width = rgb.width, height = rgb.height;
  cv::Mat channels(height, width, CV_32FC(kChannels)), light(height, width, CV_32F);
  const uint8_t* red = rgb.plane(0);
  const uint8_t* green = rgb.channels == 3 ? rgb.plane(1) : red;
  const uint8_t* blue = rgb.channels == 3 ? rgb.plane(2) : red;
  for (int y = 0; y < height; ++y) {
    ChannelPixel* row = channels.ptr<ChannelPixel>(y);
    float* light_row = light.ptr<float>(y);
    for (int x = 0; x < width; ++x) {
      const size_t i = static_cast<size_t>(y) * width + x;
      const float r = red[i], g = green[i], b = blue[i], sum = r + g + b + 6;
      const float l = std::sqrt((0.299f * r + 0.587f * g + 0.114f * b) / 255.0f);
      const float e = (2 * g - r - b) / sum;
      light_row[x] = l;
      row[x][0] = l;
      row[x][1] = e;
      row[x][2] = (r - b) / sum;
      row[x][3] = l * l;
      row[x][4] = e * e;
    }
  }
  cv::Mat dx, dy;
  cv::Sobel(light, dx, CV_32F, 1, 0, 3, 0.125, 0, cv::BORDER_REPLICATE);
  cv::Sobel(light, dy, CV_32F, 0, 1, 3, 0.125, 0, cv::BORDER_REPLICATE);
  const Eigen::Vector3d up_in_camera = view.camera.rotation_cam_from_world * up;
  for (int y = 0; y < height; ++y) {
    ChannelPixel* row = channels.ptr<ChannelPixel>(y);
    for (int x = 0; x < width; ++x) {
      const Eigen::Vector2f lift = LiftedDirection(up_in_camera, x + 0.5, y + 0.5, view.lens.pinhole);
      const float gx = dx.at<float>(y, x), gy = dy.at<float>(y, x);
      const float along = gx * lift.x() + gy * lift.y(), across = gx * lift.y() - gy * lift.x();
      row[x][5] = along * along;
      row[x][6] = across * across;
      row[x][7] = along * across;
    }
  }
  return channels;
}

cv::Mat LevelFeatures(const cv::Mat& channels) {
  cv::Mat features(channels.rows, channels.cols, CV_32FC(kPerLevel));
  for (int y = 0; y < channels.rows; ++y) {
    const ChannelPixel* in = channels.ptr<ChannelPixel>(y);
    LevelPixel* out = features.ptr<LevelPixel>(y);
    for (int x = 0; x < channels.cols; ++x) {
      const ChannelPixel& c = in[x];
      const float energy = c[5] + c[6];
      out[x] = {c[0],
                c[1],
                c[2],
                Deviation(c[0], c[3]),
                Deviation(c[1], c[4]),
                std::sqrt(energy),
                (c[5] - c[6]) / (energy + 1e-5f),
                c[7] / (energy + 1e-5f)};
    }
  }
  return features;
}

cv::Mat MeshLevelFeatures(const cv::Mat& channels) {
  cv::Mat features(channels.rows, channels.cols, CV_32FC(kMeshPerLevel));
  for (int y = 0; y < channels.rows; ++y) {
    const MeshPixel* in = channels.ptr<MeshPixel>(y);
    MeshLevelPixel* out = features.ptr<MeshLevelPixel>(y);
    for (int x = 0; x < channels.cols; ++x) {
      const float hits = std::max(in[x][0], 1e-3f);
      const float normal = in[x][1] / hits, height = in[x][3] / hits;
      out[x] = {normal, Deviation(normal, in[x][2] / hits), height, Deviation(height, in[x][4] / hits)};
    }
  }
  return features;
}

// The next pyramid level (OpenCV's pyrDown).
cv::Mat Halved(const cv::Mat& plane) {
  cv::Mat half;
  cv::pyrDown(plane, half, {(plane.cols + 1) / 2, (plane.rows + 1) / 2}, cv::BORDER_REFLECT_101);
  return half;
}

std::vector<std::string> MakeNames() {
  std::vector<std::string> names = {"light", "greenness", "red_blue", "light_contrast"};
  for (int level = 1; level <= kLevels; ++level) {
    for (const char* name : {"light", "greenness", "red_blue", "light_deviation", "greenness_deviation", "gradient",
                             "gradient_up", "gradient_skew"}) {
      names.push_back(absl::StrCat(name, "_", level));
    }
  }
  names.push_back("up_normal");
  for (const double r : MeshSurface::kGroundRadii_m) names.push_back(absl::StrCat("above_ground_", r, "m"));
  for (const double r : MeshSurface::kReliefRadii_m) names.push_back(absl::StrCat("above_lowest_", r, "m"));
  for (const double r : MeshSurface::kReliefRadii_m) names.push_back(absl::StrCat("below_highest_", r, "m"));
  for (const int level : kMeshLevels) {
    for (const char* name : {"up_normal", "up_normal_deviation", "above_ground", "above_ground_deviation"}) {
      names.push_back(absl::StrCat(name, "_", level));
    }
  }
  return names;
}

}  // namespace

const std::vector<std::string>& FeatureNames() {
  static const auto* names = new std::vector<std::string>(MakeNames());
  return *names;
}

int AppearanceFeatureCount() { return kSingle + kLevels * kPerLevel; }
int FeatureCount() {
  return AppearanceFeatureCount() + kMeshSingle + static_cast<int>(kMeshLevels.size()) * kMeshPerLevel;
}

struct ImageFeatures::Planes {
  cv::Mat channels;
  std::array<cv::Mat, kLevels> levels;
  std::vector<MeshSurface::SurfaceHit> hits;  // of every pixel; empty without a surface
  std::array<cv::Mat, kMeshLevels.size()> mesh_levels;

  bool has_surface() const { return !hits.empty(); }
};

ImageFeatures::ImageFeatures(const ByteImage& rgb, const SceneView& view, const Eigen::Vector3d& up,
                             const MeshSurface* surface)
    : planes_(std::make_unique<Planes>()) {
  Planes& planes = *planes_;
  planes.channels = ImageChannels(rgb, view, up);
  cv::Mat level = planes.channels;
  for (int l = 0; l < kLevels; ++l) {
    level = Halved(level);
    planes.levels[l] = LevelFeatures(level);
  }
  if (surface == nullptr) return;
  const int width = rgb.width, height = rgb.height;
  planes.hits.resize(static_cast<size_t>(width) * height);
  cv::Mat mesh(height, width, CV_32FC(kMeshChannels));
  const Eigen::Vector3d centre = view.camera.Centre();
  for (int y = 0; y < height; ++y) {
    MeshPixel* row = mesh.ptr<MeshPixel>(y);
    for (int x = 0; x < width; ++x) {
      const Eigen::Vector2d p = view.lens.Undistort({x + 0.5, y + 0.5});
      MeshSurface::SurfaceHit& hit = planes.hits[static_cast<size_t>(y) * width + x];
      hit = surface->Cast(centre, view.camera.Ray(p.x(), p.y()));
      if (!hit.hit) {
        row[x] = MeshPixel::all(0);
        continue;
      }
      const float h = std::clamp(hit.above_ground_m[1], -kMaxHeight_m, kMaxHeight_m);
      row[x] = {1, hit.up_normal, hit.up_normal * hit.up_normal, h, h * h};
    }
  }
  int at = 0;
  for (size_t m = 0; m < kMeshLevels.size(); ++m) {
    for (; at < kMeshLevels[m]; ++at) mesh = Halved(mesh);
    planes.mesh_levels[m] = MeshLevelFeatures(mesh);
  }
}

ImageFeatures::~ImageFeatures() = default;

int ImageFeatures::width() const { return planes_->channels.cols; }
int ImageFeatures::height() const { return planes_->channels.rows; }

void ImageFeatures::Row(int x, int y, int count, int stride, float* out) const {
  const Planes& planes = *planes_;
  const ChannelPixel* row = planes.channels.ptr<ChannelPixel>(y);
  const auto set = [&](int f, int i, float value) { out[static_cast<size_t>(f) * stride + i] = value; };
  for (int i = 0; i < count; ++i) {
    const ChannelPixel& c = row[x + i];
    set(0, i, c[0]);
    set(1, i, c[1]);
    set(2, i, c[2]);
  }
  for (int l = 0; l < kLevels; ++l) {
    // In pyrDown, pixel i of a level is centred at pixel 2 i of the level below.
    const float scale = 1.0f / static_cast<float>(2 << l);
    const int first = kSingle + l * kPerLevel;
    for (int i = 0; i < count; ++i) {
      const LevelPixel p =
          Bilinear<LevelPixel>(planes.levels[l], static_cast<float>(x + i) * scale, static_cast<float>(y) * scale);
      for (int c = 0; c < kPerLevel; ++c) set(first + c, i, p[c]);
      if (l == 3) set(3, i, row[x + i][0] - p[0]);
    }
  }
  const int mesh_first = AppearanceFeatureCount();
  if (!planes.has_surface()) {
    for (int f = mesh_first; f < FeatureCount(); ++f) std::fill_n(out + static_cast<size_t>(f) * stride, count, 0.0f);
    return;
  }
  const auto clamped = [](float height) { return std::clamp(height, -kMaxHeight_m, kMaxHeight_m); };
  for (int i = 0; i < count; ++i) {
    const MeshSurface::SurfaceHit& hit = planes.hits[static_cast<size_t>(y) * width() + x + i];
    int f = mesh_first;
    set(f++, i, hit.up_normal);
    for (const float h : hit.above_ground_m) set(f++, i, clamped(h));
    for (const float h : hit.above_lowest_m) set(f++, i, clamped(h));
    for (const float h : hit.below_highest_m) set(f++, i, clamped(h));
    for (size_t m = 0; m < kMeshLevels.size(); ++m) {
      const float scale = 1.0f / static_cast<float>(1 << kMeshLevels[m]);
      const MeshLevelPixel p = Bilinear<MeshLevelPixel>(planes.mesh_levels[m], static_cast<float>(x + i) * scale,
                                                        static_cast<float>(y) * scale);
      for (int c = 0; c < kMeshPerLevel; ++c) set(f++, i, p[c]);
    }
  }
}

PixelLocation ImageFeatures::LocationOf(int x, int y, uint32_t view) const {
  PixelLocation location;
  location.view = view;
  location.x = x;
  location.y = y;
  if (!planes_->has_surface()) return location;
  const MeshSurface::SurfaceHit& hit = planes_->hits[static_cast<size_t>(y) * width() + x];
  if (hit.hit) location.ground_m = hit.position_m;
  return location;
}

}  // namespace tessera
