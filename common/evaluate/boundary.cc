#include "common/evaluate/boundary.h"

#include <limits>
#include <utility>

namespace tessera {
namespace {

constexpr uint8_t kIgnored = 255;

// The class of each boundary pixel, 255 elsewhere. One image holds the boundaries of all classes.
LabelImage Boundaries(const LabelImage& labels, const LabelImage& truth) {
  LabelImage boundary(labels.width, labels.height, 1, kIgnored);
  for (int y = 0; y < labels.height; ++y) {
    for (int x = 0; x < labels.width; ++x) {
      if (truth.at(x, y) == kIgnored) continue;
      const uint8_t label = labels.at(x, y);
      const auto differs = [&](int nx, int ny) {
        return nx >= 0 && ny >= 0 && nx < labels.width && ny < labels.height && truth.at(nx, ny) != kIgnored &&
               labels.at(nx, ny) != label;
      };
      if (differs(x - 1, y) || differs(x + 1, y) || differs(x, y - 1) || differs(x, y + 1)) boundary.at(x, y) = label;
    }
  }
  return boundary;
}

bool Near(const LabelImage& boundary, int x, int y, uint8_t label, const std::vector<std::pair<int, int>>& offsets) {
  for (const auto& [dx, dy] : offsets) {
    const int nx = x + dx, ny = y + dy;
    if (nx >= 0 && ny >= 0 && nx < boundary.width && ny < boundary.height && boundary.at(nx, ny) == label) return true;
  }
  return false;
}

}  // namespace

// Pixels with unknown truth are excluded from both images, so that the end of the annotated area is not a boundary.
// Searching a disc per boundary pixel is fast enough, because boundaries are thin and the radius is a few pixels.
void CountBoundaries(const LabelImage& result, const LabelImage& truth, int reach_px,
                     std::vector<BoundaryCounts>* counts) {
  std::vector<std::pair<int, int>> offsets;
  for (int dy = -reach_px; dy <= reach_px; ++dy) {
    for (int dx = -reach_px; dx <= reach_px; ++dx) {
      if (dx * dx + dy * dy <= reach_px * reach_px) offsets.emplace_back(dx, dy);
    }
  }
  const LabelImage of_result = Boundaries(result, truth), of_truth = Boundaries(truth, truth);
  for (int y = 0; y < truth.height; ++y) {
    for (int x = 0; x < truth.width; ++x) {
      const uint8_t a = of_result.at(x, y), b = of_truth.at(x, y);
      if (a < counts->size()) {
        ++(*counts)[a].result;
        (*counts)[a].result_matched += Near(of_truth, x, y, a, offsets);
      }
      if (b < counts->size()) {
        ++(*counts)[b].truth;
        (*counts)[b].truth_matched += Near(of_result, x, y, b, offsets);
      }
    }
  }
}

double BoundaryF(const BoundaryCounts& counts) {
  if (counts.result == 0 && counts.truth == 0) return std::numeric_limits<double>::quiet_NaN();
  if (counts.result_matched == 0 || counts.truth_matched == 0) return 0;
  const double precision = static_cast<double>(counts.result_matched) / static_cast<double>(counts.result);
  const double recall = static_cast<double>(counts.truth_matched) / static_cast<double>(counts.truth);
  return 2 * precision * recall / (precision + recall);
}

double MeanBoundaryF(const std::vector<BoundaryCounts>& counts) {
  double sum = 0;
  int present = 0;
  for (const BoundaryCounts& c : counts) {
    if (c.truth == 0) continue;
    sum += BoundaryF(c);
    ++present;
  }
  return present ? sum / present : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace tessera
