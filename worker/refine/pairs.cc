#include "worker/refine/pairs.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <boost/graph/adjacency_list.hpp>
#include <boost/graph/cuthill_mckee_ordering.hpp>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "common/base/parallel.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

struct Sample {
  Vector3d point;
  Vector3d normal;
};

// How a view sees a sample; footprint 0: not at all.
struct Sight {
  Vector3d direction;  // unit, from the sample to the camera
  double footprint_m = 0;
};

std::vector<Sample> DrawSamples(const TriangleMesh& mesh, int count) {
  std::vector<Sample> samples;
  const size_t step = std::max<size_t>(1, mesh.faces.size() / std::max(count, 1));
  for (size_t f = step / 2; f < mesh.faces.size(); f += step) {
    const Vector3d normal = FaceNormal(mesh, f);
    if (normal.isZero()) continue;
    samples.push_back({(mesh.Corner(f, 0) + mesh.Corner(f, 1) + mesh.Corner(f, 2)) / 3, normal});
  }
  return samples;
}

Sight Look(const Sample& sample, const PosedCamera& camera) {
  constexpr double kMinCosine = 0.15;
  Sight sight;
  const Vector3d pixel = camera.Project(sample.point);
  if (!camera.InImage(pixel)) return sight;
  sight.direction = (camera.Centre() - sample.point).normalized();
  if (sight.direction.dot(sample.normal) < kMinCosine) return sight;
  sight.footprint_m = pixel.z() / camera.intrinsics.fx;
  return sight;
}

double PairQuality(const Sight& a, const Sight& b, const PairOptions& options) {
  const double angle = std::acos(std::clamp(a.direction.dot(b.direction), -1.0, 1.0));
  if (angle < options.min_angle_rad || angle > options.max_angle_rad) return 0;
  const double scale = std::max(a.footprint_m / b.footprint_m, b.footprint_m / a.footprint_m);
  if (scale > options.max_scale_ratio) return 0;
  // Rises quickly to the best angle (depth is well determined), falls slowly after it (views grow unlike).
  const double spread = angle < options.best_angle_rad ? options.best_angle_rad / 2 : options.best_angle_rad;
  const double t = (angle - options.best_angle_rad) / spread;
  return std::exp(-0.5 * t * t) / (scale * scale);
}

struct SeenSample {
  uint32_t sample;
  Sight sight;
};

// Of the pair at each sample of `own`; both ascend.
std::vector<double> Qualities(const std::vector<SeenSample>& own, const std::vector<SeenSample>& other,
                              const PairOptions& options) {
  std::vector<double> qualities;
  qualities.reserve(own.size());
  auto at = other.begin();
  for (const SeenSample& sample : own) {
    while (at != other.end() && at->sample < sample.sample) ++at;
    const bool shared = at != other.end() && at->sample == sample.sample;
    qualities.push_back(shared ? PairQuality(sample.sight, at->sight, options) : 0);
  }
  return qualities;
}

}  // namespace

std::vector<ViewPair> SelectPairs(const TriangleMesh& mesh, const std::vector<PosedCamera>& cameras,
                                  const PairOptions& options, const std::vector<uint8_t>& choosers) {
  const std::vector<Sample> samples = DrawSamples(mesh, options.samples);
  const int views = static_cast<int>(cameras.size());
  // A view of a city sees few of its samples, and shares them with few views.
  std::vector<std::vector<SeenSample>> seen(views);
  ParallelFor(views, 1, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      for (uint32_t s = 0; s < samples.size(); ++s) {
        const Sight sight = Look(samples[s], cameras[i]);
        if (sight.footprint_m > 0) seen[i].push_back({s, sight});
      }
    }
  });
  std::vector<std::vector<int>> views_of_sample(samples.size());
  for (int i = 0; i < views; ++i) {
    for (const SeenSample& sample : seen[i]) views_of_sample[sample.sample].push_back(i);
  }

  std::vector<std::vector<int>> chosen(views);
  ParallelFor(views, 1, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      if (!choosers.empty() && !choosers[i]) continue;
      std::set<int> others;
      for (const SeenSample& sample : seen[i]) {
        others.insert(views_of_sample[sample.sample].begin(), views_of_sample[sample.sample].end());
      }
      others.erase(static_cast<int>(i));
      std::map<int, std::vector<double>> quality;  // of each of these, at the samples of view i
      for (const int j : others) quality.emplace(j, Qualities(seen[i], seen[j], options));
      std::vector<double> covered(seen[i].size());
      while (static_cast<int>(chosen[i].size()) < options.partners) {
        int best = -1;
        double best_gain = 1e-3 * static_cast<double>(samples.size()) / std::max(views, 1);
        for (const auto& [j, of_pair] : quality) {
          if (std::count(chosen[i].begin(), chosen[i].end(), j) > 0) continue;
          double gain = 0;
          for (size_t s = 0; s < covered.size(); ++s) gain += of_pair[s] / (1 + 2 * covered[s]);
          if (gain > best_gain) {
            best_gain = gain;
            best = j;
          }
        }
        if (best < 0) break;
        const std::vector<double>& of_best = quality.at(best);
        for (size_t s = 0; s < covered.size(); ++s) covered[s] += of_best[s];
        chosen[i].push_back(best);
      }
    }
  });

  std::set<std::pair<int, int>> ordered;
  for (int i = 0; i < views; ++i) {
    for (int j : chosen[i]) {
      ordered.insert({i, j});
      ordered.insert({j, i});
    }
  }
  std::vector<ViewPair> pairs;
  for (const auto& [i, j] : ordered) pairs.push_back({i, j});
  return pairs;
}

std::vector<int> OrderByPairs(int views, const std::vector<ViewPair>& pairs) {
  using Graph = boost::adjacency_list<boost::vecS, boost::vecS, boost::undirectedS,
                                      boost::property<boost::vertex_color_t, boost::default_color_type>>;
  Graph graph(static_cast<size_t>(views));
  for (const ViewPair& pair : pairs) {
    if (pair.reference < pair.other) boost::add_edge(pair.reference, pair.other, graph);
  }
  std::vector<int> order(static_cast<size_t>(views));
  boost::cuthill_mckee_ordering(graph, order.rbegin(), boost::get(boost::vertex_color, graph),
                                boost::make_degree_map(graph));
  return order;
}

}  // namespace tessera
