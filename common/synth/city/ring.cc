#include "common/synth/city/ring.h"

#include <cmath>

namespace tessera {

using Eigen::AlignedBox2d;
using Eigen::Vector2d;

AlignedBox2d BoxOf(const Ring& ring) {
  AlignedBox2d box;
  for (const Vector2d& p : ring) box.extend(p);
  return box;
}

AlignedBox2d Inflated(const AlignedBox2d& box, double by) {
  return {box.min() - Vector2d::Constant(by), box.max() + Vector2d::Constant(by)};
}

double AreaOf(const Ring& ring) {
  double twice = 0;
  for (size_t k = 0; k < ring.size(); ++k) {
    const Vector2d a = ring[k] - ring[0], b = ring[(k + 1) % ring.size()] - ring[0];
    twice += a.x() * b.y() - a.y() * b.x();
  }
  return 0.5 * twice;
}

bool Inside(const Ring& ring, const Vector2d& p) {
  bool inside = false;
  for (size_t k = 0; k < ring.size(); ++k) {
    const Vector2d &a = ring[k], &b = ring[(k + 1) % ring.size()];
    if ((a.y() > p.y()) != (b.y() > p.y()) && p.x() < a.x() + (b.x() - a.x()) * (p.y() - a.y()) / (b.y() - a.y())) {
      inside = !inside;
    }
  }
  return inside;
}

Ring PointsInside(const Ring& ring, double spacing_m) {
  const AlignedBox2d box = BoxOf(ring);
  Ring points;
  for (double y = box.min().y() + 0.5 * spacing_m; y < box.max().y(); y += spacing_m) {
    for (double x = box.min().x() + 0.5 * spacing_m; x < box.max().x(); x += spacing_m) {
      if (Inside(ring, {x, y})) points.push_back({x, y});
    }
  }
  return points;
}

Ring RectangleOf(const AlignedBox2d& box) {
  return {box.corner(AlignedBox2d::BottomLeft), box.corner(AlignedBox2d::BottomRight),
          box.corner(AlignedBox2d::TopRight), box.corner(AlignedBox2d::TopLeft)};
}

Ring Widened(const Ring& ring, double by) {
  Vector2d middle = Vector2d::Zero();
  for (const Vector2d& p : ring) middle += p / static_cast<double>(ring.size());
  Ring wide;
  for (const Vector2d& p : ring) wide.push_back(p + by * std::sqrt(2.0) * (p - middle).normalized());
  return wide;
}

std::optional<Ring> UnionOf(const Ring& a, const Ring& b) {
  constexpr int kCorners = 72;
  const AlignedBox2d both = BoxOf(a).intersection(BoxOf(b));
  Vector2d middle = Vector2d::Zero();
  int shared = 0;
  for (const Vector2d& p : PointsInside(RectangleOf(both), 0.1)) {
    if (!Inside(a, p) || !Inside(b, p)) continue;
    middle += p;
    ++shared;
  }
  if (shared == 0) return std::nullopt;
  middle /= shared;
  const double furthest = BoxOf(a).merged(BoxOf(b)).diagonal().norm();
  Ring ring;
  for (int k = 0; k < kCorners; ++k) {
    const double azimuth = 6.283185307179586 * k / kCorners;
    const Vector2d direction(std::cos(azimuth), std::sin(azimuth));
    double reach = furthest;
    while (reach > 0.02 && !Inside(a, middle + reach * direction) && !Inside(b, middle + reach * direction)) {
      reach -= 0.02;
    }
    ring.push_back(middle + reach * direction);
  }
  return ring;
}

}  // namespace tessera
