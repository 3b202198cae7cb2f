#include "worker/photo/contour_term.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <span>

#include "common/base/parallel.h"
#include "worker/photo/contour_profile.h"

namespace tessera {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kCurvaturePerPx2 = 0.5;  // factor of w ρ(d)
constexpr double kMaxPull_px = 2;         // the pull does not grow beyond this distance
constexpr int64_t kRowGrain = 64;
constexpr size_t kRangeContours = 1024;

FaceContour NoContour(uint32_t face) {
  FaceContour contour;
  contour.face = face;
  for (int c = 0; c < 3; ++c) {
    contour.gradient[c].setZero();
    contour.curvature[c].setZero();
  }
  return contour;
}

// Upper triangle of the outer product v vᵀ, row by row.
Eigen::Matrix<double, 6, 1> Upper(const Vector3d& v) {
  Eigen::Matrix<double, 6, 1> out;
  out << v.x() * v.x(), v.x() * v.y(), v.x() * v.z(), v.y() * v.y(), v.y() * v.z(), v.z() * v.z();
  return out;
}

// The contours of faces [begin, end) only.
ContourSums AddContoursOfRange(const std::vector<std::vector<FaceContour>>& views, const std::vector<int32_t>& view_ids,
                               uint32_t begin, uint32_t end) {
  const auto before = [](const FaceContour& contour, uint32_t face) { return contour.face < face; };
  std::vector<std::span<const FaceContour>> in_range;  // per view, ascending
  for (const std::vector<FaceContour>& view : views) {
    const auto first = std::lower_bound(view.begin(), view.end(), begin, before);
    in_range.emplace_back(first, std::lower_bound(first, view.end(), end, before));
  }
  // Sorts by face, keeping the order of the views.
  std::vector<uint32_t> first_of(end - begin + 1, 0);  // of each face's contours
  for (const auto& view : in_range) {
    for (const FaceContour& contour : view) ++first_of[contour.face - begin + 1];
  }
  ContourSums sums;
  for (uint32_t f = begin; f < end; ++f) {
    const uint32_t first = first_of[f - begin], count = first_of[f - begin + 1];
    first_of[f - begin + 1] += first;
    if (count == 0) continue;
    sums.faces.push_back(NoContour(f));
    sums.faces.back().views_begin = first;
    sums.faces.back().views_end = first + count;
  }
  std::vector<const FaceContour*> contours(first_of.back());
  sums.views.resize(first_of.back());
  std::vector<uint32_t> next = first_of;
  for (size_t v = 0; v < views.size(); ++v) {
    for (const FaceContour& contour : in_range[v]) {
      const uint32_t at = next[contour.face - begin]++;
      sums.views[at] = view_ids[v];
      contours[at] = &contour;
    }
  }
  for (FaceContour& sum : sums.faces) {
    for (uint32_t k = sum.views_begin; k < sum.views_end; ++k) {
      for (int c = 0; c < 3; ++c) {
        sum.gradient[c] += contours[k]->gradient[c];
        sum.curvature[c] += contours[k]->curvature[c];
      }
    }
  }
  return sums;
}

// Finds and measures the contours of one view.
class ContourView {
 public:
  ContourView(const TriangleMesh& mesh, const std::vector<int32_t>& labels, const std::vector<uint8_t>& own,
              const PhotoView& view, const FaceMap& map, const ContourOptions& options)
      : mesh_(mesh),
        labels_(labels),
        own_(own),
        view_(view),
        map_(map),
        options_(options),
        gap_(static_cast<float>(options.gap_px / view.camera.intrinsics.fx)),
        centre_(view.camera.Centre()) {}

  std::vector<FaceContour> Run() {
    // In parts, whose pulls follow each other in the order of the pixels.
    std::vector<std::vector<Pull>> parts((map_.height + kRowGrain - 1) / kRowGrain);
    ParallelFor(map_.height, kRowGrain, [&](int64_t begin, int64_t end) {
      FindPulls(static_cast<int>(begin), static_cast<int>(end), &parts[begin / kRowGrain]);
    });
    std::vector<const Pull*> pulls;
    for (const std::vector<Pull>& part : parts) {
      for (const Pull& pull : part) pulls.push_back(&pull);
    }
    // Sort by face, keeping the order of the pixels.
    std::stable_sort(pulls.begin(), pulls.end(), [](const Pull* a, const Pull* b) { return a->face < b->face; });
    std::vector<FaceContour> faces;
    for (size_t i = 0; i < pulls.size();) {
      FaceContour sum = NoContour(pulls[i]->face);
      for (; i < pulls.size() && pulls[i]->face == sum.face; ++i) {
        const Pull& pull = *pulls[i];
        const double weight = options_.weight * kCurvaturePerPx2 * pull.measured.weight;
        const double residual = std::clamp(pull.measured.outward_px, -kMaxPull_px, kMaxPull_px);
        const Vector3d root = std::sqrt(weight) * pull.outward;
        for (int c = 0; c < 3; ++c) {
          sum.gradient[c] -= weight * pull.share[c] * residual * pull.outward;
          sum.curvature[c] += pull.share[c] * Upper(root);
        }
      }
      faces.push_back(sum);
    }
    return faces;
  }

 private:
  // The pull on the nearer face from one pair of adjacent pixels.
  struct Pull {
    uint32_t face = 0;
    std::array<double, 3> share;  // barycentric coordinates
    ContourMeasurement measured;
    Vector3d outward;  // pixels per metre
  };

  // Between each pixel of rows [row_begin, row_end) and the next one in its row and in its column.
  void FindPulls(int row_begin, int row_end, std::vector<Pull>* pulls) const {
    std::vector<uint8_t> jumps(map_.width);
    for (int y = row_begin; y < row_end; ++y) {
      FindJumps(y, jumps.data());
      for (int x = 0; x < map_.width; ++x) {
        const void* jump = std::memchr(&jumps[x], 1, jumps.size() - x);
        if (jump == nullptr) break;
        x = static_cast<int>(static_cast<const uint8_t*>(jump) - jumps.data());
        if (x + 1 < map_.width) AddSide(x, y, x + 1, y, pulls);
        if (y + 1 < map_.height) AddSide(x, y, x, y + 1, pulls);
      }
    }
  }

  size_t Index(int x, int y) const { return static_cast<size_t>(y) * map_.width + x; }
  Vector3d Ray(int x, int y) const { return view_.camera.Ray(map_.x0 + x + 0.5, map_.y0 + y + 0.5); }
  int LabelAt(size_t pixel) const {
    const int32_t face = map_.face[pixel];
    return face >= 0 && labels_[face] < view_.texels.classes ? labels_[face] : -1;
  }

  static bool IsJump(float a, float b, float gap) {
    const float nearer = std::min(a, b), farther = std::max(a, b);
    return farther - nearer > gap * nearer;
  }

  // Flags the pixels of a row that jump in depth to the next one in the row or in the column. Branch-free, so that the
  // compiler vectorises it.
  void FindJumps(int y, uint8_t* jumps) const {
    const int width = map_.width;
    const float gap = gap_;
    const float* depth = map_.depth.data() + Index(0, y);
    const float* below = y + 1 < map_.height ? depth + width : depth;
    for (int x = 0; x + 1 < width; ++x) {
      jumps[x] = IsJump(depth[x], depth[x + 1], gap) | IsJump(depth[x], below[x], gap);
    }
    jumps[width - 1] = IsJump(depth[width - 1], below[width - 1], gap);
  }

  void AddSide(int x0, int y0, int x1, int y1, std::vector<Pull>* pulls) const {
    const size_t p = Index(x0, y0), q = Index(x1, y1);
    if (!IsJump(map_.depth[p], map_.depth[q], gap_)) return;
    const float nearer = std::min(map_.depth[p], map_.depth[q]);
    const int32_t front = map_.depth[p] == nearer ? map_.face[p] : map_.face[q];
    if (front < 0 || (!own_.empty() && !own_[front])) return;
    const int a = LabelAt(p), b = LabelAt(q);
    if (a < 0 || b < 0 || a == b) return;
    if (map_.depth[p] == nearer) {
      AddContour(x0, y0, x1, y1, a, b, pulls);
    } else {
      AddContour(x1, y1, x0, y0, b, a, pulls);
    }
  }

  // Measures the profile from (x, y), on the nearer face, in direction (dx, dy) to the farther one.
  ContourMeasurement Measure(int x, int y, int dx, int dy, int front, int behind, const BorderTrust& trust) const {
    constexpr int kReach = ContourProfile::kReach;
    const Texels& texels = view_.texels;
    const auto inside = [&](int k) {
      const int u = x + k * dx, v = y + k * dy;
      return u >= 0 && v >= 0 && u < texels.width && v < texels.height;
    };
    if (!inside(1 - kReach) || !inside(kReach)) return {};
    ContourProfile profile;
    for (int k = 0; k < ContourProfile::kPixels; ++k) {
      const int u = x + (k + 1 - kReach) * dx, v = y + (k + 1 - kReach) * dy;
      if (!texels.Valid(u, v)) return {};
      profile.front_gain[k] = texels.Likelihood(u, v, front) - texels.Likelihood(u, v, behind);
      profile.luminance[k] = texels.Luminance(u, v);
    }
    return MeasureContour(profile, trust, std::ldexp(1.0, -options_.level));
  }

  // (x, y) is on the nearer face, (bx, by) on the farther one. Turns the measured image distance into a spring in
  // space: `outward` is the gradient of the contour's image position with respect to the point. Only this direction
  // is constrained, so the contour can still slide along the line of sight.
  void AddContour(int x, int y, int bx, int by, int front, int behind, std::vector<Pull>* pulls) const {
    const int32_t face = map_.face[Index(x, y)];
    const auto corner = [&](int c) { return mesh_.Corner(face, c); };
    const Vector3d normal = (corner(1) - corner(0)).cross(corner(2) - corner(0));
    const Vector3d ray = Ray(x, y);
    const double along = normal.dot(ray);
    if (along == 0) return;
    const Vector3d point = centre_ + normal.dot(corner(0) - centre_) / along * ray;
    const BorderTrust& trust = options_.borders.Of(front, behind);
    if (trust.weight <= 0) return;
    const ContourMeasurement measured = Measure(x, y, bx - x, by - y, front, behind, trust);
    if (measured.weight <= 0) return;
    // Motion of the contour in the image, pixels outward per metre of the point.
    const PinholeCamera& k = view_.camera.intrinsics;
    const Vector3d seen = view_.camera.CameraFromWorld(point);
    const double right = k.fx * (bx - x) / seen.z(), down = k.fy * (by - y) / seen.z();
    const Vector3d outward = view_.camera.rotation_cam_from_world.transpose() *
                             Vector3d(right, down, -(right * seen.x() + down * seen.y()) / seen.z());
    const double area2 = normal.squaredNorm();
    Pull pull = {static_cast<uint32_t>(face), {}, measured, outward};
    for (int c = 0; c < 3; ++c) {
      const Vector3d opposite = (corner((c + 2) % 3) - corner((c + 1) % 3)).cross(point - corner((c + 1) % 3));
      pull.share[c] = std::clamp(opposite.dot(normal) / area2, 0.0, 1.0);
    }
    pulls->push_back(pull);
  }

  const TriangleMesh& mesh_;
  const std::vector<int32_t>& labels_;
  const std::vector<uint8_t>& own_;
  const PhotoView& view_;
  const FaceMap& map_;
  const ContourOptions& options_;
  const float gap_;  // of depth, relative to the nearer depth
  const Vector3d centre_;
};

}  // namespace

Matrix3d FaceContour::Curvature(int corner) const {
  const Eigen::Matrix<double, 6, 1>& m = curvature[corner];
  Matrix3d out;
  out << m[0], m[1], m[2], m[1], m[3], m[4], m[2], m[4], m[5];
  return out;
}

void ContourSums::Append(uint32_t face, const FaceContour& contour, const std::vector<int32_t>& its_views) {
  FaceContour& added = faces.emplace_back(contour);
  added.face = face;
  added.views_begin = static_cast<uint32_t>(views.size());
  views.insert(views.end(), its_views.begin() + contour.views_begin, its_views.begin() + contour.views_end);
  added.views_end = static_cast<uint32_t>(views.size());
}

std::vector<FaceContour> FindContours(const TriangleMesh& mesh, const std::vector<int32_t>& labels,
                                      const std::vector<uint8_t>& own, const PhotoView& view, const FaceMap& map,
                                      const ContourOptions& options) {
  if (view.texels.classes == 0 || map.width == 0) return {};
  return ContourView(mesh, labels, own, view, map, options).Run();
}

ContourSums AddContours(const std::vector<std::vector<FaceContour>>& views, const std::vector<int32_t>& view_ids) {
  // By ranges of faces: a range has about kRangeContours contours.
  uint32_t faces = 0;
  size_t count = 0;
  for (const std::vector<FaceContour>& view : views) {
    if (!view.empty()) faces = std::max(faces, view.back().face + 1);
    count += view.size();
  }
  if (count == 0) return {};
  const size_t ranges = (count + kRangeContours - 1) / kRangeContours;
  const auto first_face = [&](size_t range) { return static_cast<uint32_t>(faces * range / ranges); };
  std::vector<ContourSums> parts(ranges);
  ParallelForEach(ranges, 1, [&](size_t range) {
    parts[range] = AddContoursOfRange(views, view_ids, first_face(range), first_face(range + 1));
  });
  std::vector<size_t> faces_before(ranges + 1, 0), views_before(ranges + 1, 0);
  for (size_t range = 0; range < ranges; ++range) {
    faces_before[range + 1] = faces_before[range] + parts[range].faces.size();
    views_before[range + 1] = views_before[range] + parts[range].views.size();
  }
  ContourSums sums;
  sums.faces.resize(faces_before.back());
  sums.views.resize(views_before.back());
  ParallelForEach(ranges, 1, [&](size_t range) {
    const auto shift = static_cast<uint32_t>(views_before[range]);
    FaceContour* to = sums.faces.data() + faces_before[range];
    for (const FaceContour& contour : parts[range].faces) {
      *to = contour;
      to->views_begin += shift;
      to->views_end += shift;
      ++to;
    }
    std::copy(parts[range].views.begin(), parts[range].views.end(),
              sums.views.begin() + static_cast<ptrdiff_t>(views_before[range]));
  });
  return sums;
}

}  // namespace tessera
