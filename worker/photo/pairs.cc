#include "worker/photo/pairs.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <boost/graph/adjacency_list.hpp>
#include <boost/graph/cuthill_mckee_ordering.hpp>
#include <cmath>
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

// A sample as seen by a view; footprint 0: not visible.
struct SampleView {
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

SampleView MakeSampleView(const Sample& sample, const PosedCamera& camera) {
  constexpr double kMinCosine = 0.15;
  SampleView sample_view;
  const Vector3d pixel = camera.Project(sample.point);
  if (!camera.InImage(pixel)) return sample_view;
  sample_view.direction = (camera.Centre() - sample.point).normalized();
  if (sample_view.direction.dot(sample.normal) < kMinCosine) return sample_view;
  sample_view.footprint_m = pixel.z() / camera.intrinsics.fx;
  return sample_view;
}

// Quality of a pair for one sample, from both views of it.
class PairQuality {
 public:
  explicit PairQuality(const PairOptions& options)
      : options_(options),
        // Cosine bounds, to skip computing the angle outside them.
        least_cosine_(std::cos(options.max_angle_rad) - kRounding),
        most_cosine_(std::cos(options.min_angle_rad) + kRounding) {}

  double operator()(const SampleView& a, const SampleView& b) const {
    const double cosine = a.direction.dot(b.direction);
    if (cosine < least_cosine_ || cosine > most_cosine_) return 0;
    const double angle = std::acos(std::clamp(cosine, -1.0, 1.0));
    if (angle < options_.min_angle_rad || angle > options_.max_angle_rad) return 0;
    const double scale = std::max(a.footprint_m / b.footprint_m, b.footprint_m / a.footprint_m);
    if (scale > options_.max_scale_ratio) return 0;
    // Rises quickly up to the best angle, since depth becomes well determined, and falls slowly beyond, since the
    // images become dissimilar.
    const double spread = angle < options_.best_angle_rad ? options_.best_angle_rad / 2 : options_.best_angle_rad;
    const double t = (angle - options_.best_angle_rad) / spread;
    return std::exp(-0.5 * t * t) / (scale * scale);
  }

 private:
  static constexpr double kRounding = 1e-9;
  const PairOptions& options_;
  const double least_cosine_, most_cosine_;
};

struct ViewOfSample {
  int view;
  SampleView sample_view;
};
struct SeenSample {
  uint32_t sample;
  SampleView sample_view;
};

// A candidate partner of a view.
struct Candidate {
  int view = 0;
  std::vector<std::pair<uint32_t, double>> quality;  // quality at the view's samples, ascending by sample; not 0
  // Gain at its last evaluation. An upper bound of the current gain, since coverage by other partners only reduces
  // it.
  double gain = 0;
};

double GainOf(const Candidate& candidate, const std::vector<double>& covered) {
  double gain = 0;
  for (const auto& [s, quality] : candidate.quality) gain += quality / (1 + 2 * covered[s]);
  return gain;
}

// Greedy selection by marginal gain with lazy evaluation (submodular function); ties: the first.
std::vector<int> ChooseGreedily(std::vector<Candidate> candidates, size_t samples, int partners, double least_gain) {
  std::vector<double> covered(samples, 0);
  for (Candidate& candidate : candidates) candidate.gain = GainOf(candidate, covered);
  const auto better = [](const Candidate& a, const Candidate& b) {
    return a.gain != b.gain ? a.gain > b.gain : a.view < b.view;
  };
  std::vector<int> chosen;
  while (static_cast<int>(chosen.size()) < partners && !candidates.empty()) {
    // Re-evaluate only candidates that may still be the best.
    std::sort(candidates.begin(), candidates.end(), better);
    size_t best = 0;
    for (size_t c = 0; c < candidates.size(); ++c) {
      if (c > 0 && candidates[c].gain < candidates[best].gain) break;
      candidates[c].gain = GainOf(candidates[c], covered);
      if (better(candidates[c], candidates[best])) best = c;
    }
    if (candidates[best].gain <= least_gain) break;
    for (const auto& [s, quality] : candidates[best].quality) covered[s] += quality;
    chosen.push_back(candidates[best].view);
    candidates.erase(candidates.begin() + static_cast<std::ptrdiff_t>(best));
  }
  return chosen;
}

}  // namespace

std::vector<ViewPair> SelectPairs(const TriangleMesh& mesh, const std::vector<PosedCamera>& cameras,
                                  const PairOptions& options, const std::vector<uint8_t>& choosers) {
  const std::vector<Sample> samples = DrawSamples(mesh, options.samples);
  const int views = static_cast<int>(cameras.size());
  // Sparse: a view of a city sees few of its samples and shares them with few views.
  std::vector<std::vector<SeenSample>> seen(views);
  ParallelForEach(views, 1, [&](int64_t i) {
    for (uint32_t s = 0; s < samples.size(); ++s) {
      const SampleView sample_view = MakeSampleView(samples[s], cameras[i]);
      if (sample_view.footprint_m > 0) seen[i].push_back({s, sample_view});
    }
  });
  std::vector<std::vector<ViewOfSample>> views_of_sample(samples.size());
  for (int i = 0; i < views; ++i) {
    for (const SeenSample& sample : seen[i]) views_of_sample[sample.sample].push_back({i, sample.sample_view});
  }

  const PairQuality quality_of(options);
  const double least_gain = 1e-3 * static_cast<double>(samples.size()) / std::max(views, 1);
  std::vector<std::vector<int>> chosen(views);
  ParallelForEach(views, 1, [&](int64_t i) {
    if (!choosers.empty() && !choosers[i]) return;
    std::vector<int> place(views, -1);  // position among the candidates
    std::vector<Candidate> candidates;
    for (size_t s = 0; s < seen[i].size(); ++s) {
      for (const ViewOfSample& other : views_of_sample[seen[i][s].sample]) {
        if (other.view == i) continue;
        const double quality = quality_of(seen[i][s].sample_view, other.sample_view);
        if (quality == 0) continue;
        int& at = place[other.view];
        if (at < 0) {
          at = static_cast<int>(candidates.size());
          candidates.emplace_back().view = other.view;
        }
        candidates[at].quality.emplace_back(static_cast<uint32_t>(s), quality);
      }
    }
    chosen[i] = ChooseGreedily(std::move(candidates), seen[i].size(), options.partners, least_gain);
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
