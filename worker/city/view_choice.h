// View selection for a surface patch: high visibility and resolution, all directions, limited number.
#pragma once

#include <cstdint>
#include <vector>

namespace tessera {

inline constexpr int kViewDirections = 5;  // from above and from four sides

// A view in which a sample of the surface is visible.
struct SampleObservation {
  int32_t view = 0;
  int direction = 0;  // 0 to kViewDirections - 1: of the view from the sample
  double pixels =
      0;  // projected area of the sample: grows with its size, with shorter distance and with a steeper angle
  double px_per_m = 0;  // image resolution, perpendicular to the line of sight
};

struct ViewChoiceOptions {
  // Maximum per direction. Fewer views cost accuracy: 4 up to 3 %, 2 from 7 to 32 % (accuracy_bench --sweep
  // views_per_direction=2,4).
  int views_per_direction = 8;
  double min_share = 0.05;  // minimum, relative to the best view of a direction
  double coarsest = 3;      // relative to the GSD of a sample's second best view: coarser views count 0
};

// Reduces `pixels` of observations that are coarser than the sample's second finest: unchanged up to its GSD, falling
// to 0 at options.coarsest times that. The second finest is the reference because matching takes two views: one
// close-up must not exclude its partners.
void WeighByResolution(const ViewChoiceOptions& options, std::vector<SampleObservation>* observations_of_sample);

// Greedy selection per direction; returns ascending view indices. A view belongs to the direction from which it shows
// most pixels. Each step adds the view that shows most, where the pixels of a sample are divided by one plus the
// number of selected views of this direction that already show it, so that samples seen by few views are covered
// first. Views that show less than options.min_share of the best one, and those beyond options.views_per_direction,
// are dropped. Ties: lower index.
std::vector<int32_t> ChooseBalanced(const std::vector<std::vector<SampleObservation>>& samples,
                                    const ViewChoiceOptions& options);

}  // namespace tessera
