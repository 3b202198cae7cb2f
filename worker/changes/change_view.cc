#include "worker/changes/change_view.h"

#include <algorithm>
#include <cmath>

namespace tessera {
namespace {

struct Candidate {
  int view = 0;
  double tilt_rad = 0;
  double seen = 0;              // share of the block's corners and middle
  Eigen::Vector2d slope{0, 0};  // way in the plane a metre of height, towards the camera
};

// A pair's worth: windows on the ground match best at a third of base to height and bear up to about one.
double PairWorth(double base_to_height) { return std::abs(std::log(base_to_height / 0.35)); }

}  // namespace

ViewChoice ChooseViews(const std::vector<PosedCamera>& cameras, const GroundPlane& ground,
                       const Eigen::AlignedBox2d& block, double height_m, const ViewChoiceOptions& options) {
  const Eigen::Vector3d up = ground.axis_x.cross(ground.axis_y);
  const auto point = [&](const Eigen::Vector2d& p) -> Eigen::Vector3d {
    return ground.axis_x * p.x() + ground.axis_y * p.y() + up * height_m;
  };
  const Eigen::Vector3d middle = point(block.center());
  std::vector<Candidate> candidates;
  for (size_t v = 0; v < cameras.size(); ++v) {
    const auto sees = [&](const Eigen::Vector3d& p) { return cameras[v].InImage(cameras[v].Project(p)); };
    Candidate candidate{static_cast<int>(v), 0, 0, {}};
    for (const auto corner : {Eigen::AlignedBox2d::BottomLeft, Eigen::AlignedBox2d::BottomRight,
                              Eigen::AlignedBox2d::TopLeft, Eigen::AlignedBox2d::TopRight}) {
      candidate.seen += sees(point(block.corner(corner))) ? 0.2 : 0;
    }
    candidate.seen += sees(middle) ? 0.2 : 0;
    const Eigen::Vector3d ray = cameras[v].Centre() - middle;
    if (candidate.seen == 0 || up.dot(ray) <= 0) continue;
    candidate.slope = ground.Coordinates(ray) / up.dot(ray);
    candidate.tilt_rad = std::atan(candidate.slope.norm());
    if (candidate.tilt_rad <= options.max_tilt_rad) candidates.push_back(candidate);
  }
  // Steep views first; those that show little of the block count as tilted.
  const auto rank = [](const Candidate& c) { return c.tilt_rad + 0.5 * (1 - c.seen); };
  std::stable_sort(candidates.begin(), candidates.end(),
                   [&](const Candidate& a, const Candidate& b) { return rank(a) < rank(b); });
  ViewChoice choice;
  std::vector<Candidate> chosen;
  for (const Candidate& c : candidates) {
    const int count = static_cast<int>(chosen.size());
    if (count < options.max_views && (c.tilt_rad <= options.near_nadir_rad || count < options.few_views)) {
      chosen.push_back(c);
    }
  }
  std::sort(chosen.begin(), chosen.end(), [](const Candidate& a, const Candidate& b) { return a.view < b.view; });
  std::vector<std::pair<double, std::array<int, 2>>> pairs;
  for (size_t i = 0; i < chosen.size(); ++i) {
    choice.views.push_back(chosen[i].view);
    for (size_t j = i + 1; j < chosen.size(); ++j) {
      const double base = (chosen[i].slope - chosen[j].slope).norm();
      if (base < options.min_base_to_height) continue;
      pairs.push_back({PairWorth(base), {static_cast<int>(i), static_cast<int>(j)}});
    }
  }
  std::stable_sort(pairs.begin(), pairs.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  if (static_cast<int>(pairs.size()) > options.max_pairs) pairs.resize(options.max_pairs);
  for (const auto& [worth, pair] : pairs) {
    choice.pairs.push_back(pair);
    choice.base_to_height = std::max(choice.base_to_height, (chosen[pair[0]].slope - chosen[pair[1]].slope).norm());
  }
  return choice;
}

}  // namespace tessera
