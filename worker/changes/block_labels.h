// Class likelihoods of the new views on surfaces over the ground plane.
#ifndef TESSERA_WORKER_CHANGES_BLOCK_LABELS_H_
#define TESSERA_WORKER_CHANGES_BLOCK_LABELS_H_

#include <span>
#include <vector>

#include "common/job/ground.h"
#include "worker/changes/change_raster.h"
#include "worker/changes/change_view.h"

namespace tessera {

// Likelihoods at cells' middles in the chosen views.
class BlockLikelihoods {
 public:
  // All must outlive it.
  BlockLikelihoods(const CellRect& cells, const GroundPlane& ground, std::span<const ChangeView> views,
                   const ViewChoice& choice, int classes);

  // How much the views' likelihoods agree at each cell at `height_m`: the mean over pairs of views of the chance that
  // both name the same class, in [0, 1]; NaN where fewer than two views have likelihoods.
  void Agreement(double height_m, std::vector<float>* agreement) const;

  // Of each cell at its height of `heights_m` the likelihoods summed over the views that see it past the cells of
  // `occluders_m`: classes values a cell; and how many views see it, with likelihoods or without. NaN: nothing there.
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

#endif  // TESSERA_WORKER_CHANGES_BLOCK_LABELS_H_
