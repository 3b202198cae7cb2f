// Class likelihoods of the new views on surfaces over the ground plane.
#ifndef TESSERA_WORKER_CHANGES_BLOCK_LABELS_H_
#define TESSERA_WORKER_CHANGES_BLOCK_LABELS_H_

#include <span>
#include <vector>

#include "common/tile/ground.h"
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

  // Of each cell of `surface` (the same cells) the likelihoods summed over the views that see it, with nothing of
  // `surface` in between: classes values a cell; and how many views see it, with likelihoods or without.
  void Collect(const SurfaceRaster& surface, std::vector<float>* sums, std::vector<int>* seen) const;

 private:
  bool At(const ChangeView& view, const Eigen::Vector3d& p, float* likelihoods) const;

  CellRect cells_;
  const GroundPlane& ground_;
  std::span<const ChangeView> views_;
  const ViewChoice& choice_;
  int classes_;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_CHANGES_BLOCK_LABELS_H_
