#include "worker/changes/outline.h"

#include <algorithm>
#include <map>
#include <set>
#include <utility>

namespace tessera {
namespace {

using Corner = std::pair<int, int>;  // (y, x), so that the first in order is the lowest

double Cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

double DistanceToSegment(const Eigen::Vector2d& p, const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  const Eigen::Vector2d way = b - a;
  const double length = way.squaredNorm();
  const double share = length > 0 ? std::clamp((p - a).dot(way) / length, 0.0, 1.0) : 0.0;
  return (p - a - share * way).norm();
}

// Marks the corners to keep between `first` and `last`. `last` may be the ring's size, which stands for corner 0.
void Keep(const Ring& ring, size_t first, size_t last, double tolerance, std::vector<uint8_t>* kept) {
  double farthest = tolerance;
  size_t at = 0;
  for (size_t i = first + 1; i < last; ++i) {
    const double distance = DistanceToSegment(ring[i], ring[first], ring[last % ring.size()]);
    if (distance > farthest) {
      farthest = distance;
      at = i;
    }
  }
  if (at == 0) return;
  (*kept)[at] = 1;
  Keep(ring, first, at, tolerance, kept);
  Keep(ring, at, last, tolerance, kept);
}

}  // namespace

double SignedArea(const Ring& ring) {
  double twice = 0;
  for (size_t i = 0; i < ring.size(); ++i) twice += Cross(ring[i], ring[(i + 1) % ring.size()]);
  return 0.5 * twice;
}

Outline TraceOutline(const std::vector<Eigen::Vector2i>& cells) {
  std::set<Corner> inside;
  for (const Eigen::Vector2i& c : cells) inside.insert({c.y(), c.x()});
  const auto has = [&](int x, int y) { return inside.count({y, x}) > 0; };
  // Directed cell sides with the cell on their left, by start corner. Directions: 0 east, 1 north, 2 west, 3 south.
  std::map<Corner, std::set<int>> sides;
  for (const Eigen::Vector2i& c : cells) {
    const int x = c.x(), y = c.y();
    if (!has(x, y - 1)) sides[{y, x}].insert(0);
    if (!has(x + 1, y)) sides[{y, x + 1}].insert(1);
    if (!has(x, y + 1)) sides[{y + 1, x + 1}].insert(2);
    if (!has(x - 1, y)) sides[{y + 1, x}].insert(3);
  }
  constexpr int kDx[] = {1, 0, -1, 0}, kDy[] = {0, 1, 0, -1};
  Outline outline;
  while (!sides.empty()) {
    const Corner start = sides.begin()->first;
    int direction = *sides.begin()->second.begin();
    Ring ring;
    Corner at = start;
    int before = -1;
    const int first_direction = direction;
    while (true) {
      if (direction != before) ring.emplace_back(at.second, at.first);
      auto own = sides.find(at);
      own->second.erase(direction);
      if (own->second.empty()) sides.erase(own);
      at = {at.first + kDy[direction], at.second + kDx[direction]};
      before = direction;
      const auto next = sides.find(at);
      if (next == sides.end()) break;
      // Where two cells touch at a corner only, stay at the current cell: prefer left over straight over right.
      int turned = -1;
      for (const int turn : {1, 0, 3}) {
        const int way = (direction + turn) % 4;
        if (turned < 0 && ((at == start && way == first_direction) || next->second.count(way) > 0)) turned = way;
      }
      if (turned < 0 || (at == start && turned == first_direction)) break;
      direction = turned;
    }
    // The start is a corner only if the direction changes there.
    if (before == first_direction && ring.size() > 1) ring.erase(ring.begin());
    if (SignedArea(ring) > 0) {
      outline.outer = std::move(ring);
    } else {
      outline.holes.push_back(std::move(ring));
    }
  }
  return outline;
}

Ring SimplifyRing(const Ring& ring, double tolerance) {
  if (ring.size() <= 4 || tolerance <= 0) return ring;
  // Split the ring between two corners that are far apart.
  size_t far = 0;
  for (size_t i = 1; i < ring.size(); ++i) {
    if ((ring[i] - ring[0]).squaredNorm() > (ring[far] - ring[0]).squaredNorm()) far = i;
  }
  std::vector<uint8_t> kept(ring.size(), 0);
  kept[0] = kept[far] = 1;
  Keep(ring, 0, far, tolerance, &kept);
  Keep(ring, far, ring.size(), tolerance, &kept);
  Ring simple;
  for (size_t i = 0; i < ring.size(); ++i) {
    if (kept[i]) simple.push_back(ring[i]);
  }
  return simple.size() < 3 || SignedArea(simple) * SignedArea(ring) <= 0 ? ring : simple;
}

}  // namespace tessera
