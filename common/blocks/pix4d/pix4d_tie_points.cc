// The file has, for each image, a line with its name without extension, lines "id x y scale", and a line -99. Points of
// several images with one id are one point. x, y: pixels in the distorted image, from its upper left corner.
#include "common/blocks/pix4d/pix4d_tie_points.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <filesystem>
#include <map>
#include <unordered_map>
#include <unordered_set>

#include "absl/strings/str_cat.h"
#include "common/colmap/colmap_lines.h"
#include "common/meshio/text_words.h"

namespace tessera {
namespace {

constexpr size_t kMaxPix4dTiePointFaults = 200;
constexpr double kMinPix4dRayAngle_rad = 0.01;  // below it the depth of a point is arbitrary

// The undistorted position of `p`, by Gauss-Newton steps with the identity as derivative. False if they diverge.
bool UndistortPix4dPoint(const LensModel& lens, const Eigen::Vector2d& p, Eigen::Vector2d& undistorted) {
  undistorted = p;
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector2d error = p - lens.Distort(undistorted);
    undistorted += error;
    if (!undistorted.allFinite()) return false;
    if (error.norm() < 1e-9) return true;
  }
  return (p - lens.Distort(undistorted)).norm() < 0.01;
}

struct Pix4dRay {
  const BlockImage* image;
  const PinholeCamera* pinhole;
  Eigen::Vector2d undistorted_px;
  Eigen::Vector3d direction;  // unit, block
};

// The point nearest to the rays, then moved to the least squares of distances in undistorted images.
bool TriangulatePix4dPoint(const std::vector<Pix4dRay>& rays, Eigen::Vector3d& point) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (const Pix4dRay& ray : rays) {
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - ray.direction * ray.direction.transpose();
    normal += across;
    right += across * ray.image->centre;
  }
  // Of two rays at a small angle a, the smallest eigenvalue is a^2 / 2.
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(normal, Eigen::EigenvaluesOnly);
  if (!(eigen.eigenvalues()[0] > kMinPix4dRayAngle_rad * kMinPix4dRayAngle_rad / 2)) return false;
  point = normal.ldlt().solve(right);
  for (int step = 0; step < 4; ++step) {
    Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    for (const Pix4dRay& ray : rays) {
      const Eigen::Vector3d x = ray.image->rotation_cam_from_block * (point - ray.image->centre);
      if (!(x.z() > 0)) return false;
      const PinholeCamera& p = *ray.pinhole;
      const Eigen::Vector2d error(p.fx * x.x() / x.z() + p.cx - ray.undistorted_px.x(),
                                  p.fy * x.y() / x.z() + p.cy - ray.undistorted_px.y());
      Eigen::Matrix<double, 2, 3> jacobian;
      jacobian << p.fx / x.z(), 0, -p.fx * x.x() / (x.z() * x.z()), 0, p.fy / x.z(), -p.fy * x.y() / (x.z() * x.z());
      jacobian = jacobian * ray.image->rotation_cam_from_block;
      hessian += jacobian.transpose() * jacobian;
      gradient += jacobian.transpose() * error;
    }
    point -= hessian.ldlt().solve(gradient);
  }
  return point.allFinite();
}

}  // namespace

void ParsePix4dTiePoints(const std::string& text, const std::string& name, ImportedBlock* block, Faults* faults) {
  std::map<std::string, int> images;  // by name, with and without extension
  for (int i = 0; i < static_cast<int>(block->images.size()); ++i) {
    images.emplace(std::filesystem::path(block->images[i].path).stem().string(), i);
    images.emplace(block->images[i].path, i);
  }
  ColmapLineReader lines(text, name);
  std::unordered_map<int64_t, std::vector<BlockObservation>> observations;
  std::vector<int64_t> ids;  // in the order of the file
  std::unordered_set<std::string> unknown;
  bool in_image = false;
  int image = -1;
  while (lines.NextEntry() && faults->messages().size() < kMaxPix4dTiePointFaults) {
    if (!in_image) {
      const std::string of_image = lines.Rest();
      const auto it = images.find(of_image);
      image = it == images.end() ? -1 : it->second;
      if (image < 0) unknown.insert(of_image);
      in_image = true;
      continue;
    }
    int64_t id = 0;
    BlockObservation observation;
    double scale = 0;
    const std::string first = lines.Peek();
    const bool has_id = lines.Number(&id);
    if (has_id && id == -99 && lines.AtEnd()) {
      in_image = false;
      continue;
    }
    if (!has_id || !lines.Number(&observation.position_px.x()) || !lines.Number(&observation.position_px.y()) ||
        !lines.Number(&scale) || !lines.AtEnd() || !observation.position_px.allFinite()) {
      faults->Add(lines.Location().Error(first, "a tie point's id, x, y and scale, or -99"));
      continue;
    }
    if (image < 0) continue;
    observation.image = image;
    std::vector<BlockObservation>& of_point = observations[id];
    if (of_point.empty()) ids.push_back(id);
    of_point.push_back(observation);
  }
  if (in_image && faults->empty()) {
    faults->Add(lines.Location().Error("the end of the file", "-99 after the tie points of an image"));
  }
  if (!faults->empty()) return;
  int64_t left_out = 0;
  for (const int64_t id : ids) {
    BlockTiePoint point;
    std::vector<Pix4dRay> rays;
    for (const BlockObservation& o : observations[id]) {
      const BlockImage& of = block->images[o.image];
      const LensModel& lens = block->cameras[of.camera].lens;
      const PinholeCamera& p = lens.pinhole;
      Eigen::Vector2d undistorted;
      if (!UndistortPix4dPoint(lens, o.position_px, undistorted)) continue;
      const Eigen::Vector3d ray((undistorted.x() - p.cx) / p.fx, (undistorted.y() - p.cy) / p.fy, 1);
      rays.push_back({&of, &p, undistorted, (of.rotation_cam_from_block.transpose() * ray).normalized()});
      point.observations.push_back(o);
    }
    if (rays.size() < 2 || !TriangulatePix4dPoint(rays, point.position)) {
      ++left_out;
      continue;
    }
    block->points.push_back(std::move(point));
  }
  if (left_out > 0) {
    block->left_out.push_back(
        absl::StrCat(left_out, " of ", ids.size(), " tie points: in one image only, or with nearly parallel rays"));
  }
  if (!unknown.empty()) {
    block->left_out.push_back(absl::StrCat("tie points of ", unknown.size(), " images without camera parameters"));
  }
  block->conventions.push_back("Pix4D: positions of tie points in space are triangulated from tp_pix4d.txt.");
}

}  // namespace tessera
