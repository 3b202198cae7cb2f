#include "worker/changes/change_view.h"

#include <algorithm>
#include <cmath>

namespace tessera {
namespace {

constexpr int kPlaces = 5;                     // grid points per block and axis
constexpr int kMaxViews = 14, kMaxPairs = 30;  // per block
constexpr double kNearNadir_rad = 0.60;        // more oblique views are used only if a block has no others
constexpr double kMaxTilt_rad = 1.05;
constexpr double kMinBaseToHeight = 0.08;

// A view relative to a point.
struct ViewGeometry {
  bool sees = false;
  double tilt_rad = 0;
  Eigen::Vector2d slope{0, 0};  // towards the camera, metres in the plane per metre of height
};

// Cost of a pair by its parallax: windows on the ground match best at a base-to-height ratio of about a third, and up
// to about one.
double PairCost(double base_to_height) { return std::abs(std::log(base_to_height / 0.35)); }

}  // namespace

ViewChoice ChooseViews(const std::vector<PosedCamera>& cameras, const GroundPlane& ground,
                       const Eigen::AlignedBox2d& block, double height_m, const BlockViewOptions& options) {
  const Eigen::Vector3d up = ground.axis_x.cross(ground.axis_y);
  std::vector<Eigen::Vector3d> places;
  for (int j = 0; j < kPlaces; ++j) {
    for (int i = 0; i < kPlaces; ++i) {
      const Eigen::Vector2d share = Eigen::Vector2d(i + 0.5, j + 0.5) / kPlaces;
      const Eigen::Vector2d p = block.min() + share.cwiseProduct(block.sizes());
      places.push_back(ground.axis_x * p.x() + ground.axis_y * p.y() + up * height_m);
    }
  }
  std::vector<std::vector<ViewGeometry>> geometry(cameras.size(), std::vector<ViewGeometry>(places.size()));
  for (size_t v = 0; v < cameras.size(); ++v) {
    for (size_t k = 0; k < places.size(); ++k) {
      const Eigen::Vector3d ray = cameras[v].Centre() - places[k];
      if (up.dot(ray) <= 0 || !cameras[v].InImage(cameras[v].Project(places[k]))) continue;
      const Eigen::Vector2d slope = ground.Coordinates(ray) / up.dot(ray);
      const double tilt_rad = std::atan(slope.norm());
      if (tilt_rad <= kMaxTilt_rad) geometry[v][k] = {true, tilt_rad, slope};
    }
  }
  const auto steep = [&](size_t v, size_t k) {
    return geometry[v][k].sees && geometry[v][k].tilt_rad <= kNearNadir_rad;
  };
  bool has_steep = false;
  for (size_t k = 0; k < places.size(); ++k) {
    int own = 0;
    for (size_t v = 0; v < cameras.size(); ++v) own += steep(v, k);
    has_steep = has_steep || own >= 2;
  }
  // The most vertical views of each point; views already chosen for other points come first.
  std::vector<uint8_t> chosen(cameras.size(), 0);
  int count = 0;
  for (size_t k = 0; k < places.size(); ++k) {
    std::vector<size_t> seeing;
    for (size_t v = 0; v < cameras.size(); ++v) {
      if (has_steep ? steep(v, k) : geometry[v][k].sees) seeing.push_back(v);
    }
    const auto rank = [&](size_t v) { return geometry[v][k].tilt_rad - (chosen[v] ? 0.15 : 0); };
    std::stable_sort(seeing.begin(), seeing.end(), [&](size_t a, size_t b) { return rank(a) < rank(b); });
    int own = 0;
    for (const size_t v : seeing) {
      if (own >= options.views_per_place) break;
      if (!chosen[v] && count >= kMaxViews) continue;
      count += !chosen[v];
      chosen[v] = 1;
      ++own;
    }
  }
  ViewChoice choice;
  for (size_t v = 0; v < cameras.size(); ++v) {
    if (chosen[v]) choice.views.push_back(static_cast<int>(v));
  }
  // The best pairs of each point.
  std::vector<std::array<int, 2>> pairs;
  for (size_t k = 0; k < places.size(); ++k) {
    std::vector<std::pair<double, std::array<int, 2>>> own;
    for (size_t i = 0; i < choice.views.size(); ++i) {
      for (size_t j = i + 1; j < choice.views.size(); ++j) {
        const ViewGeometry &a = geometry[choice.views[i]][k], &b = geometry[choice.views[j]][k];
        const double base = (a.slope - b.slope).norm();
        if (!a.sees || !b.sees || base < kMinBaseToHeight) continue;
        own.push_back({PairCost(base), {static_cast<int>(i), static_cast<int>(j)}});
        choice.base_to_height = std::max(choice.base_to_height, PairCost(base) < 1 ? base : 0);
      }
    }
    std::stable_sort(own.begin(), own.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    if (static_cast<int>(own.size()) > options.pairs_per_place) own.resize(options.pairs_per_place);
    for (const auto& [worth, pair] : own) {
      const bool is_new = std::find(pairs.begin(), pairs.end(), pair) == pairs.end();
      if (is_new && static_cast<int>(pairs.size()) < kMaxPairs) pairs.push_back(pair);
    }
  }
  std::sort(pairs.begin(), pairs.end());
  choice.pairs = std::move(pairs);
  if (choice.base_to_height == 0) choice.base_to_height = kMinBaseToHeight;
  return choice;
}

}  // namespace tessera
