// Which views a place is refined from: those that show most of it, in good detail, from all sides, and not too many.
#ifndef TESSERA_WORKER_CITY_VIEW_CHOICE_H_
#define TESSERA_WORKER_CITY_VIEW_CHOICE_H_

#include <cstdint>
#include <vector>

namespace tessera {

inline constexpr int kViewDirections = 5;  // from above and from four sides

// A view that sees a sample of the surface, unhidden.
struct Sighting {
  int32_t view = 0;
  int direction = 0;    // of kViewDirections, that the view has on the sample
  double pixels = 0;    // of the sample's area in the view: how large, how near and how little aslant it is
  double px_per_m = 0;  // in the view, across the line of sight
};

struct ViewChoiceOptions {
  // Kept at most. Fewer cost accuracy: 4 up to 3 %, 2 from 7 to 32 % (accuracy_bench --sweep views_per_direction=2,4).
  int views_per_direction = 8;
  double min_share = 0.05;  // of what the best view of a direction shows
  double coarsest = 3;      // times the GSD of the second best view of a sample: from there on a view adds nothing
};

// Lessens the pixels of sightings that are coarser than the second finest of the sample (it takes two to compare; one
// close-up must not take its partners away): as they are up to its GSD, none from options.coarsest times that on.
void WeighDetail(const ViewChoiceOptions& options, std::vector<Sighting>* sightings_of_sample);

// Indices of the chosen views, ascending. A view counts for the direction that it has on most of what it shows. In each
// direction views are chosen one after another by the pixels that they show, those of a sample divided by one more than
// the chosen ones of this direction that show it already: so that with few views, too, what only few see is seen. Views
// that show less than options.min_share of what the best one does are left out, and what is beyond
// options.views_per_direction. Of equals the lower index is taken.
std::vector<int32_t> ChooseBalanced(const std::vector<std::vector<Sighting>>& samples,
                                    const ViewChoiceOptions& options);

}  // namespace tessera

#endif  // TESSERA_WORKER_CITY_VIEW_CHOICE_H_
