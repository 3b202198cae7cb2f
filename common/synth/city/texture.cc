#include "common/synth/city/texture.h"

#include <algorithm>
#include <cmath>

#include "common/synth/noise.h"

namespace tessera {
namespace {

using Eigen::Vector3f;

// Noise with wavelengths from about one GSD to metres; standard deviation about 0.5.
float Detail(double u, double v, double gsd, uint32_t seed) {
  return 0.55f * ValueNoise2(u / (0.8 * gsd), v / (0.8 * gsd), seed) +
         0.75f * ValueNoise2(u / (1.9 * gsd), v / (1.9 * gsd), seed + 1) +
         0.6f * ValueNoise2(u / (5.0 * gsd), v / (5.0 * gsd), seed + 2) +
         0.4f * ValueNoise2(u / 1.7, v / 1.7, seed + 3);
}

// Multiplies the colour by a brightness factor of at least 0.25, so that strong detail does not become black.
Vector3f Modulate(const Vector3f& color, float factor) { return color * std::max(0.25f, factor); }

Vector3f BrickCourses(const SurfacePatch& patch, double u, double v, double length, double height, double joint,
                      float spread) {
  const double row = std::floor(v / height);
  const double shifted = u + (std::fmod(row, 2.0) == 0 ? 0 : 0.5 * length);
  const double column = std::floor(shifted / length);
  const double in_u = shifted - column * length, in_v = v - row * height;
  if (in_u < joint || in_v < joint) return patch.albedo * 0.8f + Vector3f::Constant(0.08f);
  const float pick = LatticeValue(static_cast<int32_t>(column), static_cast<int32_t>(row), 7, patch.seed);
  return patch.albedo * (1.f + spread * pick);
}

Vector3f Window(const SurfacePatch& patch, double u, double v) {
  const double w = patch.extent_m.x(), h = patch.extent_m.y(), bar = 0.07;
  const bool frame = u < bar || v < bar || u > w - bar || v > h - bar || std::abs(u - 0.5 * w) < 0.5 * bar ||
                     std::abs(v - 0.66 * h) < 0.5 * bar;
  if (frame)
    return LatticeUniform(5, 0, 0, patch.seed) < 0.7f ? Vector3f(0.62f, 0.62f, 0.6f) : Vector3f(0.2f, 0.14f, 0.09f);
  // Some panes have curtains; all have a gradient of reflected sky.
  const float curtain = LatticeUniform(6, 0, 0, patch.seed);
  const float drawn = curtain < 0.4f && (u < 0.22 * w || u > 0.78 * w) ? 0.35f : 0.f;
  const float blind = curtain > 0.75f && v > h * (0.35 + 0.5 * LatticeUniform(8, 0, 0, patch.seed)) ? 0.3f : 0.f;
  return patch.albedo * (0.7f + 0.6f * static_cast<float>(v / h)) + Vector3f::Constant(std::max(drawn, blind)) +
         Vector3f::Constant(0.03f * ValueNoise2(u / 0.35, v / 0.35, patch.seed));
}

Vector3f Street(const CityPlan& plan, double x, double y, double gsd, uint32_t seed) {
  const double u = x - plan.MinX(), v = y - plan.MinY();
  const double along_u =
      u - CityPlan::kPitch * std::round(u / CityPlan::kPitch);  // signed distance from the street's axis
  const double along_v = v - CityPlan::kPitch * std::round(v / CityPlan::kPitch);
  const bool crossing = std::abs(along_u) < CityPlan::kHalfStreet && std::abs(along_v) < CityPlan::kHalfStreet;
  float shade = 0.17f;
  // Repaired patches of darker or lighter asphalt.
  const int32_t px = static_cast<int32_t>(std::floor(x / 3.3)), py = static_cast<int32_t>(std::floor(y / 2.1));
  if (LatticeUniform(px, py, 1, seed) < 0.16f) shade *= 0.7f + 0.7f * LatticeUniform(px, py, 2, seed);
  const auto marking = [&](double across, double along) {
    if (std::abs(across) < 0.09 && std::fmod(along + 1000 * CityPlan::kPitch, 3.0) < 1.6) return true;
    const double to_crossing = std::abs(along - CityPlan::kPitch * std::round(along / CityPlan::kPitch));
    return to_crossing > CityPlan::kHalfStreet + 0.4 && to_crossing < CityPlan::kHalfStreet + 2.6 &&
           std::abs(across) < 4.6 && std::fmod(across + 100.0, 1.1) < 0.5;
  };
  if (!crossing && (std::abs(along_u) < CityPlan::kHalfStreet ? marking(along_u, v) : marking(along_v, u)))
    shade = 0.62f;
  return Vector3f(shade, shade, shade * 1.03f) * std::max(0.3f, 1.f + 0.42f * Detail(x, y, gsd, seed));
}

Vector3f GroundCover(const CityPlan& plan, const SurfacePatch& patch, double x, double y) {
  const double gsd = plan.gsd_m;
  const uint32_t seed = patch.seed;
  if (!IsRaised(plan, x, y)) return Street(plan, x, y, gsd, seed);
  const double u = x - plan.MinX(), v = y - plan.MinY();
  const bool inside = u >= 0 && v >= 0 && x <= plan.MaxX() && y <= plan.MaxY();
  const double from_kerb_u = std::abs(u - CityPlan::kPitch * std::round(u / CityPlan::kPitch)) - CityPlan::kHalfStreet;
  const double from_kerb_v = std::abs(v - CityPlan::kPitch * std::round(v / CityPlan::kPitch)) - CityPlan::kHalfStreet;
  const double from_kerb = std::min(from_kerb_u, from_kerb_v);
  if (inside && from_kerb < CityPlan::kSidewalk) {
    if (from_kerb < 0.18) return Vector3f(0.46f, 0.45f, 0.43f) * (1.f + 0.25f * Detail(x, y, gsd, seed));
    SurfacePatch slabs = patch;
    slabs.albedo = {0.34f, 0.33f, 0.31f};
    return BrickCourses(slabs, u, v, 0.75, 0.5, 0.03, 0.22f) * std::max(0.3f, 1.f + 0.25f * Detail(x, y, gsd, seed));
  }
  // Inside blocks: paved where a broad noise is below a threshold (extent_m.x is the paved share), else grass and soil.
  const float broad = ValueNoise2(x / 9.0, y / 9.0, seed + 11) + 0.25f * ValueNoise2(x / 2.0, y / 2.0, seed + 12);
  if (inside && broad < 2.f * patch.extent_m.x() - 1.f) {
    SurfacePatch paving = patch;
    paving.albedo = {0.36f, 0.31f, 0.27f};
    return BrickCourses(paving, u, v, 0.9, 0.9, 0.05, 0.3f) * std::max(0.3f, 1.f + 0.3f * Detail(x, y, gsd, seed));
  }
  const float dry = 0.5f + 0.5f * ValueNoise2(x / 6.0, y / 6.0, seed + 13);
  const Vector3f grass = Vector3f(0.11f, 0.2f, 0.05f) * (1.f - dry) + Vector3f(0.25f, 0.24f, 0.1f) * dry;
  return grass * std::max(0.25f, 1.f + 0.5f * Detail(x, y, gsd, seed));
}

}  // namespace

Eigen::Vector3f Albedo(const CityPlan& plan, const SurfacePatch& patch, const Eigen::Vector3d& p) {
  if (patch.material == Material::kGroundCover) return GroundCover(plan, patch, p.x(), p.y());
  const double gsd = plan.gsd_m;
  const Eigen::Vector3d offset = p - patch.origin;
  const double u = offset.dot(patch.u), v = offset.dot(patch.v);
  const uint32_t seed = patch.seed;
  switch (patch.material) {
    case Material::kPlaster: {
      // Vertical streaks of dirt.
      const float streak = ValueNoise2(u / 0.5, v / 4.0, seed + 9);
      return Modulate(patch.albedo, 1.f + 0.22f * Detail(u, v, gsd, seed) + 0.1f * streak);
    }
    case Material::kBrick:
      return Modulate(BrickCourses(patch, u, v, std::max(0.25, 1.6 * gsd), std::max(0.08, 0.7 * gsd), 0.012, 0.4f),
                      1.f + 0.3f * Detail(u, v, gsd, seed));
    case Material::kConcrete: {
      const bool joint = std::fmod(u + 300, 2.6) < 0.04 || std::fmod(v + 300, 1.5) < 0.04;
      return Modulate(patch.albedo, (joint ? 0.65f : 1.f) + 0.24f * Detail(u, v, gsd, seed));
    }
    case Material::kPlainWall:
      return Modulate(patch.albedo, 1.f + 0.02f * Detail(u, v, gsd, seed));
    case Material::kWindow:
      return Window(patch, u, v);
    case Material::kDoor:
      return Vector3f(0.22f, 0.12f, 0.07f) * (1.f + 0.2f * Detail(u, v, gsd, seed));
    case Material::kRoofTiles: {
      const double row = 0.36, column = 0.3;
      const Vector3f tile = BrickCourses(patch, u, v, column, row, 0.0, 0.33f);
      const float shade = 1.f - 0.35f * static_cast<float>(1.0 - (v - row * std::floor(v / row)) / row);
      const float moss = std::max(0.f, ValueNoise2(u / 2.3, v / 2.3, seed + 5) - 0.25f);
      return Modulate(tile, shade + 0.33f * Detail(u, v, gsd, seed)) * (1.f - moss) +
             Vector3f(0.13f, 0.15f, 0.06f) * moss;
    }
    case Material::kRoofMetal: {
      const double seam = std::fmod(u + 300, 0.6);
      return Modulate(patch.albedo, (seam < 0.06 ? 1.5f : 1.f) + 0.16f * Detail(u, v, gsd, seed));
    }
    case Material::kRoofGravel: {
      const float puddle = ValueNoise2(u / 2.7, v / 2.7, seed + 6) > 0.35f ? 0.72f : 1.f;
      return Modulate(patch.albedo, puddle + 0.38f * Detail(u, v, gsd, seed));
    }
    case Material::kRoofPlain:
      return Modulate(patch.albedo, 1.f + 0.025f * Detail(u, v, gsd, seed));
    case Material::kFoliage: {
      const Eigen::Vector3d q = offset / gsd;
      const float leaves = 0.7f * ValueNoise3(q.x() / 1.1, q.y() / 1.1, q.z() / 1.1, seed) +
                           0.75f * ValueNoise3(q.x() / 2.6, q.y() / 2.6, q.z() / 2.6, seed + 1) +
                           0.6f * ValueNoise3(q.x() / 7.0, q.y() / 7.0, q.z() / 7.0, seed + 2);
      return Modulate(patch.albedo, 1.f + 0.7f * leaves);
    }
    case Material::kBark:
      return Modulate(patch.albedo, 1.f + 0.4f * Detail(u, v, gsd, seed));
    case Material::kGroundCover:
      break;
  }
  return patch.albedo;
}

}  // namespace tessera
