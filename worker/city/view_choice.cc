#include "worker/city/view_choice.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <map>
#include <utility>

namespace tessera {
namespace {

struct Candidate {
  std::array<double, kViewDirections> by_direction = {};
  std::vector<std::pair<size_t, double>> shown;  // samples and their pixels
  double pixels = 0;
  bool chosen = false;

  int direction() const {
    return static_cast<int>(std::max_element(by_direction.begin(), by_direction.end()) - by_direction.begin());
  }
};

using Candidates = std::map<int32_t, Candidate>;

Candidates Collect(const std::vector<std::vector<SampleObservation>>& samples) {
  Candidates candidates;
  for (size_t s = 0; s < samples.size(); ++s) {
    for (const SampleObservation& observation : samples[s]) {
      if (observation.pixels <= 0) continue;
      Candidate& candidate = candidates[observation.view];
      candidate.by_direction[observation.direction] += observation.pixels;
      candidate.pixels += observation.pixels;
      candidate.shown.emplace_back(s, observation.pixels);
    }
  }
  return candidates;
}

void ChooseIn(int direction, size_t samples, const ViewChoiceOptions& options, Candidates* candidates) {
  std::vector<Candidate*> open;
  double best = 0;
  for (auto& [view, candidate] : *candidates) {
    if (candidate.direction() != direction) continue;
    open.push_back(&candidate);
    best = std::max(best, candidate.pixels);
  }
  std::erase_if(open, [&](const Candidate* c) { return c->pixels < options.min_share * best; });
  std::vector<int> times_shown(samples, 0);
  for (int i = 0; i < options.views_per_direction && !open.empty(); ++i) {
    size_t next = 0;
    double next_gain = -1;
    for (size_t c = 0; c < open.size(); ++c) {
      double gain = 0;
      for (const auto& [sample, pixels] : open[c]->shown) gain += pixels / (1 + times_shown[sample]);
      if (gain > next_gain) next = c, next_gain = gain;
    }
    open[next]->chosen = true;
    for (const auto& [sample, pixels] : open[next]->shown) ++times_shown[sample];
    open.erase(open.begin() + static_cast<std::ptrdiff_t>(next));
  }
}

}  // namespace

void WeighByResolution(const ViewChoiceOptions& options, std::vector<SampleObservation>* observations_of_sample) {
  double finest = 0, second = 0;
  for (const SampleObservation& observation : *observations_of_sample) {
    second = std::max(second, std::min(finest, observation.px_per_m));
    finest = std::max(finest, observation.px_per_m);
  }
  if (second <= 0) return;
  for (SampleObservation& observation : *observations_of_sample) {
    const double coarser = second / observation.px_per_m;  // relative to the second best GSD
    observation.pixels *= std::clamp((options.coarsest - coarser) / (options.coarsest - 1), 0.0, 1.0);
  }
}

std::vector<int32_t> ChooseBalanced(const std::vector<std::vector<SampleObservation>>& samples,
                                    const ViewChoiceOptions& options) {
  Candidates candidates = Collect(samples);
  for (int direction = 0; direction < kViewDirections; ++direction) {
    ChooseIn(direction, samples.size(), options, &candidates);
  }
  std::vector<int32_t> chosen;
  for (const auto& [view, candidate] : candidates) {
    if (candidate.chosen) chosen.push_back(view);
  }
  return chosen;
}

}  // namespace tessera
