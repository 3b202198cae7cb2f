// Class likelihoods of the new views, sampled on surfaces over the ground plane.
#pragma once

#include <span>
#include <vector>

#include "common/job/ground.h"
#include "worker/changes/change_raster.h"
#include "worker/changes/change_view.h"

namespace tessera {

// Samples likelihoods at cell centres in the chosen views.
class BlockLikelihoods {
 public:
  // All arguments must outlive the object.
  BlockLikelihoods(const CellRect& cells, const GroundPlane& ground, std::span<const ChangeView> views,
                   const ViewChoice& choice, int classes);

  // Agreement of the views' likelihoods at each cell at `height_m`, in [0, 1]: the mean over pairs of views of the
  // probability that both have the same class. NaN if fewer than two views have likelihoods there.
  void Agreement(double height_m, std::vector<float>* agreement) const;

  // For each cell at its height in `heights_m`: `sums`, the likelihoods summed over the views that see it and in
  // which the surface `occluders_m` does not hide it (`classes` values per cell), and `seen`, the number of such
  // views with or without likelihoods. Cells of NaN height are skipped.
  void Collect(std::span<const float> heights_m, std::span<const float> occluders_m, std::vector<float>* sums,
               std::vector<int>* seen) const;

 private:
  bool Hidden(int x, int y, double height_m, const Eigen::Vector3d& to_camera, std::span<const float> occluders_m,
              double top_m) const;
  bool At(const ChangeView& view, const Eigen::Vector3d& p, float* likelihoods) const;

  CellRect cells_;
  const GroundPlane& ground_;
  std::span<const ChangeView> views_;
  const ViewChoice& choice_;
  int classes_;
};

}  // namespace tessera
