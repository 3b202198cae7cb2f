#include "worker/refine/photo_term.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>

#include "common/base/parallel.h"

namespace tessera {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kStripRows = 64;
constexpr int64_t kFaceGrain = 2048;

Matrix3d Calibration(const PinholeCamera& k) {
  Matrix3d out = Matrix3d::Identity();
  out(0, 0) = k.fx;
  out(1, 1) = k.fy;
  out(0, 2) = k.cx;
  out(1, 2) = k.cy;
  return out;
}

// q = z·M x̃ + t from the reference's pixels to the other's.
void SetWarp(const PosedCamera& reference, const PosedCamera& other, ZnccPair* pair) {
  const Matrix3d rotation = other.rotation_cam_from_world * reference.rotation_cam_from_world.transpose();
  const Matrix3d k = Calibration(other.intrinsics);
  const Matrix3d m = k * rotation * Calibration(reference.intrinsics).inverse();
  const Vector3d t = k * (other.translation_cam_from_world - rotation * reference.translation_cam_from_world);
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) pair->m[3 * r + c] = static_cast<float>(m(r, c));
    pair->t[r] = static_cast<float>(t(r));
  }
}

double Seconds(const Clock* clock) { return clock ? 1e-6 * static_cast<double>(clock->MonotonicUs()) : 0; }

}  // namespace

PaddedPlane ToPaddedPlane(const FloatImage& image) {
  PaddedPlane plane;
  plane.Reset(image.width, image.height);
  for (int y = 0; y < image.height; ++y) {
    std::copy_n(image.data.data() + static_cast<size_t>(y) * image.width, image.width, plane.row(y));
  }
  return plane;
}

ZnccWindow MakeWindow(int size_px, bool gaussian) {
  ZnccWindow window;
  window.radius = std::clamp(size_px / 2, 1, ZnccWindow::kMaxRadius);
  const double sigma = (2 * window.radius + 1) / 4.0;
  double sum = 0;
  double taps[2 * ZnccWindow::kMaxRadius + 1] = {};
  for (int k = 0; k <= 2 * window.radius; ++k) {
    const double t = (k - window.radius) / sigma;
    taps[k] = gaussian ? std::exp(-0.5 * t * t) : 1;
    sum += taps[k];
  }
  for (int k = 0; k <= 2 * window.radius; ++k) window.taps[k] = static_cast<float>(taps[k] / sum);
  return window;
}

PhotoTerm::PhotoTerm(const std::vector<PhotoView>& views, const std::vector<ViewPair>& pairs,
                     const PhotoOptions& options)
    : views_(views), pairs_(pairs), options_(options), maps_(views.size()) {}

void PhotoTerm::PrepareReference(const TriangleMesh& mesh, const std::vector<Vector3d>& normals, int view) {
  const PosedCamera& camera = views_[view].camera;
  const PinholeCamera& k = camera.intrinsics;
  const FaceMap& map = maps_[view];
  const PaddedPlane& luminance = views_[view].luminance;
  const Vector3d centre = camera.Centre();
  depth_.Reset(k.width, k.height);
  depth_factor_.Reset(k.width, k.height);
  gradient_.Reset(k.width, k.height);
  curvature_.Reset(k.width, k.height);
  count_.Reset(k.width, k.height);
  used_faces_.assign(mesh.faces.size(), 0);
  const float limit = -static_cast<float>(options_.min_cosine);
  ParallelFor(k.height, 16, [&](int64_t begin, int64_t end) {
    for (int64_t y = begin; y < end; ++y) {
      const float ry = static_cast<float>((static_cast<double>(y) + 0.5 - k.cy) / k.fy);
      int32_t last_face = -1, marked = -1;
      float offset = 0;
      for (int x = 0; x < k.width; ++x) {
        const size_t i = static_cast<size_t>(y) * k.width + x;
        const int32_t f = map.face[i];
        if (f < 0 || std::isnan(luminance.row(static_cast<int>(y))[x])) continue;
        if (f != last_face) {
          offset = static_cast<float>(normals[f].dot(mesh.Corner(f, 0) - centre));
          last_face = f;
        }
        const float z = map.depth[i];
        const float rx = static_cast<float>((x + 0.5 - k.cx) / k.fx);
        const float ray = std::sqrt(1 + rx * rx + ry * ry);
        if (!(offset < limit * z * ray)) continue;
        if (f != marked) {
          std::atomic_ref<uint8_t>(used_faces_[f]).store(1, std::memory_order_relaxed);
          marked = f;
        }
        depth_.row(static_cast<int>(y))[x] = z;
        depth_factor_.row(static_cast<int>(y))[x] = z / offset;
      }
    }
  });
}

void PhotoTerm::GatherFaces(const TriangleMesh& mesh, int view) {
  const PosedCamera& camera = views_[view].camera;
  const PinholeCamera& k = camera.intrinsics;
  const FaceMap& map = maps_[view];
  ParallelFor(static_cast<int64_t>(mesh.faces.size()), kFaceGrain, [&](int64_t begin, int64_t end) {
    for (int64_t f = begin; f < end; ++f) {
      if (!used_faces_[f]) continue;
      std::array<Vector3d, 3> p;
      bool in_front = true;
      for (int c = 0; c < 3; ++c) {
        p[c] = camera.Project(mesh.Corner(f, c));
        in_front = in_front && p[c].z() > 1e-3;
      }
      if (!in_front) continue;
      const double x_min = std::min({p[0].x(), p[1].x(), p[2].x()}), x_max = std::max({p[0].x(), p[1].x(), p[2].x()});
      const double y_min = std::min({p[0].y(), p[1].y(), p[2].y()}), y_max = std::max({p[0].y(), p[1].y(), p[2].y()});
      if (!(x_max > 0 && y_max > 0 && x_min < k.width && y_min < k.height)) continue;
      const int x0 = std::max(0, static_cast<int>(x_min)), x1 = std::min(k.width, static_cast<int>(x_max) + 1);
      const int y0 = std::max(0, static_cast<int>(y_min)), y1 = std::min(k.height, static_cast<int>(y_max) + 1);
      const double ax = p[1].x() - p[0].x(), ay = p[1].y() - p[0].y(), bx = p[2].x() - p[0].x(),
                   by = p[2].y() - p[0].y();
      const double area = ax * by - ay * bx;
      if (std::abs(area) < 1e-12) continue;
      const double inverse_area = 1 / area;
      const double iz0 = 1 / p[0].z(), iz1 = 1 / p[1].z(), iz2 = 1 / p[2].z();
      FaceSums sums;
      int pixels = 0;
      float seen = 0;
      for (int y = y0; y < y1; ++y) {
        const int32_t* ids = map.face.data() + static_cast<size_t>(y) * k.width;
        for (int x = x0; x < x1; ++x) {
          if (ids[x] != f) continue;
          ++pixels;
          seen += count_.row(y)[x];
          const float g = gradient_.row(y)[x], h = curvature_.row(y)[x];
          if (h == 0) continue;
          const double dx = x + 0.5 - p[0].x(), dy = y + 0.5 - p[0].y();
          const double l1 = (dx * by - dy * bx) * inverse_area, l2 = (ax * dy - ay * dx) * inverse_area;
          const double z = 1 / ((1 - l1 - l2) * iz0 + l1 * iz1 + l2 * iz2);
          const float phi[3] = {static_cast<float>((1 - l1 - l2) * iz0 * z), static_cast<float>(l1 * iz1 * z),
                                static_cast<float>(l2 * iz2 * z)};
          for (int c = 0; c < 3; ++c) {
            sums.gradient[c] += phi[c] * g;
            sums.curvature[c] += phi[c] * h;
          }
        }
      }
      if (pixels == 0) continue;
      FaceSums& total = face_sums_[f];
      for (int c = 0; c < 3; ++c) {
        total.gradient[c] += sums.gradient[c];
        total.curvature[c] += sums.curvature[c];
      }
      total.pairs += seen / static_cast<float>(pixels);
    }
  });
}

void PhotoTerm::GatherVertices(const TriangleMesh& mesh, const std::vector<Vector3d>& normals, PhotoDerivatives* out) {
  const size_t n = mesh.vertices.size();
  out->gradient.assign(n, Vector3d::Zero());
  out->curvature.assign(n, Matrix3d::Zero());
  out->pairs.assign(n, 0);
  std::vector<float> seen_faces(n, 0);
  // In the order of faces on one thread: a small share of the time, and the same sums for any number of threads.
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const FaceSums& sums = face_sums_[f];
    if (sums.pairs == 0) continue;
    const Vector3d& normal = normals[f];
    const Matrix3d outer = normal * normal.transpose();
    for (int c = 0; c < 3; ++c) {
      const uint32_t v = mesh.faces[f][c];
      out->gradient[v] += static_cast<double>(sums.gradient[c]) * normal;
      out->curvature[v] += static_cast<double>(sums.curvature[c]) * outer;
      out->pairs[v] += sums.pairs;
      seen_faces[v] += 1;
    }
  }
  for (size_t v = 0; v < n; ++v) {
    if (out->pairs[v] == 0) continue;
    out->pairs[v] /= seen_faces[v];
    const double scale = 1 / std::max(1.0, static_cast<double>(out->pairs[v]));
    out->gradient[v] *= scale;
    out->curvature[v] *= scale;
  }
}

void PhotoTerm::Evaluate(const TriangleMesh& mesh, const TriangleMesh& occluders, const Clock* clock,
                         PhotoDerivatives* out) {
  const double start_s = Seconds(clock);
  std::vector<Vector3d> normals(mesh.faces.size());
  ParallelFor(static_cast<int64_t>(mesh.faces.size()), kFaceGrain, [&](int64_t begin, int64_t end) {
    for (int64_t f = begin; f < end; ++f) normals[f] = FaceNormal(mesh, f);
  });
  for (size_t i = 0; i < views_.size(); ++i) maps_[i] = RasterizeFaces(mesh, &occluders, views_[i].camera);
  const double visible_s = Seconds(clock);

  face_sums_.assign(mesh.faces.size(), FaceSums());
  out->sums = ZnccSums();
  out->warped_pixels = 0;
  for (size_t first = 0; first < pairs_.size();) {
    const int i = pairs_[first].reference;
    size_t last = first;
    while (last < pairs_.size() && pairs_[last].reference == i) ++last;
    PrepareReference(mesh, normals, i);
    std::vector<ZnccPair> warps(last - first);
    for (size_t p = first; p < last; ++p) {
      const int j = pairs_[p].other;
      ZnccPair& warp = warps[p - first];
      warp.reference = &views_[i].luminance;
      warp.depth = &depth_;
      warp.depth_factor = &depth_factor_;
      warp.other = &views_[j].luminance;
      warp.other_depth = maps_[j].depth.data();
      SetWarp(views_[i].camera, views_[j].camera, &warp);
      warp.depth_slack = static_cast<float>(options_.occlusion_px / views_[j].camera.intrinsics.fx);
    }
    const int height = views_[i].camera.intrinsics.height;
    const int strips = (height + kStripRows - 1) / kStripRows;
    std::vector<ZnccSums> sums(strips);
    ParallelFor(strips, 1, [&](int64_t begin, int64_t end) {
      ZnccScratch scratch;
      for (int64_t strip = begin; strip < end; ++strip) {
        const int row_begin = static_cast<int>(strip) * kStripRows, row_end = std::min(height, row_begin + kStripRows);
        for (const ZnccPair& warp : warps) {
          const ZnccSums part =
              AccumulateZncc(warp, options_.window, row_begin, row_end, &gradient_, &curvature_, &count_, &scratch);
          sums[strip].energy += part.energy;
          sums[strip].weight += part.weight;
          sums[strip].windows += part.windows;
        }
      }
    });
    for (const ZnccSums& part : sums) {
      out->sums.energy += part.energy;
      out->sums.weight += part.weight;
      out->sums.windows += part.windows;
    }
    out->warped_pixels += static_cast<int64_t>(warps.size()) * height * views_[i].camera.intrinsics.width;
    GatherFaces(mesh, i);
    first = last;
  }
  GatherVertices(mesh, normals, out);
  out->seconds_visibility = visible_s - start_s;
  out->seconds_photo = Seconds(clock) - visible_s;
}

}  // namespace tessera
