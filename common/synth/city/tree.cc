#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <vector>

#include "common/synth/city/surface.h"
#include "common/synth/noise.h"

namespace tessera {
namespace {

// The relative radius of the crown in direction `d` (unit vector in the frame scaled by the radii); 1 on average.
double Roughness(const TreeSpec& spec, const Eigen::Vector3d& d) {
  return 1.0 + 0.22 * ValueNoise3(d.x() * 1.7 + 9, d.y() * 1.7 + 9, d.z() * 1.7 + 9, spec.seed) +
         0.12 * ValueNoise3(d.x() * 4.1 + 9, d.y() * 4.1 + 9, d.z() * 4.1 + 9, spec.seed + 1);
}

}  // namespace

double CrownDistance(const TreeSpec& spec, const Eigen::Vector3d& p) {
  const Eigen::Vector3d centre = spec.foot + Eigen::Vector3d(0, 0, spec.crown_z_m);
  const Eigen::Vector3d q = (p - centre).cwiseQuotient(spec.radii_m);
  const double length = q.norm();
  if (length < 1e-9) return -spec.radii_m.minCoeff();
  const double crown = (length - Roughness(spec, q / length)) * spec.radii_m.minCoeff();
  // Cameras do not see below a crown, so reconstruction fills a cylinder there.
  const double side = Eigen::Vector2d(p.x() - centre.x(), p.y() - centre.y()).norm() - 0.6 * spec.radii_m.x();
  return std::min(crown, std::max({side, p.z() - centre.z(), spec.foot.z() - 1 - p.z()}));
}

std::vector<Eigen::Vector2d> CrownOutline(const TreeSpec& spec) {
  constexpr int kCorners = 40, kElevations = 40;
  constexpr double kPi = 3.141592653589793;
  std::vector<Eigen::Vector2d> outline;
  for (int k = 0; k < kCorners; ++k) {
    const double azimuth = 2 * kPi * k / kCorners;
    double reach = 0;
    for (int e = 1; e < kElevations; ++e) {
      const double elevation = kPi * e / kElevations - 0.5 * kPi, level = std::cos(elevation);
      const Eigen::Vector3d d(level * std::cos(azimuth), level * std::sin(azimuth), std::sin(elevation));
      reach = std::max(reach, Roughness(spec, d) * level);
    }
    outline.push_back(spec.foot.head<2>() +
                      reach *
                          Eigen::Vector2d(std::cos(azimuth), std::sin(azimuth)).cwiseProduct(spec.radii_m.head<2>()));
  }
  return outline;
}

void BuildTree(const TreeSpec& spec, BlockSolids& block) {
  SolidBuilder builder(block, spec.foot, 0);
  const double trunk = 0.09 * spec.radii_m.x() + 0.05;
  builder.Box({-trunk, -trunk, -1.0}, {trunk, trunk, spec.crown_z_m},
              {Material::kBark, {0.16f, 0.11f, 0.07f}, kVegetation},
              {Material::kBark, {0.16f, 0.11f, 0.07f}, kVegetation}, spec.seed, false);
  builder.Begin();
  const float tint = LatticeUniform(0, 0, 0, spec.seed);
  const uint32_t patch =
      builder.Patch(Material::kFoliage, spec.seed, {0.09f + 0.07f * tint, 0.17f + 0.05f * tint, 0.05f + 0.02f * tint},
                    {0, 0, 0}, Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitY());
  // A subdivided octahedron: 8 n^2 faces with edges of at most about 0.5 m.
  const int n = std::min(14, std::max(6, static_cast<int>(spec.radii_m.x() * 6)));
  const auto at = [&](const Eigen::Vector3d& on_octahedron) {
    const Eigen::Vector3d d = on_octahedron.normalized();
    return Eigen::Vector3d(Eigen::Vector3d(0, 0, spec.crown_z_m) + Roughness(spec, d) * d.cwiseProduct(spec.radii_m));
  };
  for (int octant = 0; octant < 8; ++octant) {
    const Eigen::Vector3d a(octant & 1 ? -1 : 1, 0, 0), b(0, octant & 2 ? -1 : 1, 0), c(0, 0, octant & 4 ? -1 : 1);
    const bool flipped = (((octant & 1) + ((octant >> 1) & 1) + ((octant >> 2) & 1)) % 2) != 0;
    const auto corner = [&](int i, int j) { return at((a * (n - i - j) + b * i + c * j) / n); };
    const auto add = [&](const Eigen::Vector3d& p, const Eigen::Vector3d& q, const Eigen::Vector3d& r) {
      if (flipped) {
        builder.Triangle(p, r, q, kVegetation, patch);
      } else {
        builder.Triangle(p, q, r, kVegetation, patch);
      }
    };
    for (int i = 0; i < n; ++i) {
      for (int j = 0; i + j < n; ++j) {
        add(corner(i, j), corner(i + 1, j), corner(i, j + 1));
        if (i + j + 1 < n) add(corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1));
      }
    }
  }
}

}  // namespace tessera
