#include "worker/tile/visible_set.h"

#include <algorithm>

#include "worker/visibility/visible_cells.h"

namespace tessera {

VisibleSet FindVisibleSet(const Survey& survey, const std::vector<uint8_t>& core, const std::vector<int32_t>& views,
                          const VisibleSetOptions& options, std::span<const Eigen::AlignedBox3d> boxes) {
  const size_t cells = survey.cells.size();
  const Eigen::Vector3d motion = Eigen::Vector3d::Constant(options.motion_m);
  VisibleCellsProblem problem;
  for (size_t c = 0; c < cells; ++c) {
    const SurveyCell& cell = survey.cells[c];
    const Eigen::AlignedBox3d box = boxes.empty() ? Eigen::AlignedBox3d(cell.box_min, cell.box_max) : boxes[c];
    problem.boxes.emplace_back(box.min() - motion, box.max() + motion);
  }
  for (const int32_t view : views) {
    problem.views.emplace_back(survey.views[view].camera);
    std::vector<uint32_t>& own = problem.own.emplace_back();
    for (uint32_t c = 0; c < cells; ++c) {
      const std::vector<int32_t>& chosen = survey.cells[c].views;
      if (core[c] && std::binary_search(chosen.begin(), chosen.end(), view)) own.push_back(c);
    }
  }
  const auto place = [&](int32_t view) {
    const auto found = std::lower_bound(views.begin(), views.end(), view);
    return found == views.end() || *found != view ? -1 : static_cast<int32_t>(found - views.begin());
  };
  for (const auto& [reference, other] : survey.pairs) {
    const int32_t r = place(reference), o = place(other);
    if (r >= 0 && o >= 0) problem.pairs.push_back({r, o});
  }
  problem.reference_margin_px = options.reference_margin_px;
  problem.target_margin_px = options.target_margin_px;
  const VisibleCells found = FindVisibleCells(problem);
  VisibleSet visible;
  visible.cells.assign(cells, 0);
  for (size_t v = 0; v < views.size(); ++v) {
    for (const uint32_t c : found.cells[v]) visible.cells[c] = 1;
    // A view that no selected cell shows has no pixels to compare.
    const bool useful =
        !problem.own[v].empty() || std::any_of(found.cells[v].begin(), found.cells[v].end(), [&](uint32_t c) {
          const std::vector<int32_t>& chosen = survey.cells[c].views;
          return std::binary_search(chosen.begin(), chosen.end(), views[v]);
        });
    const PixelRect r = useful ? found.windows[v] : PixelRect();
    const PinholeCamera& k = problem.views[v].camera.intrinsics;
    const int align = options.alignment_px;
    const auto up = [align](int x, int limit) { return std::min(limit, (x + align - 1) / align * align); };
    visible.windows.push_back(
        r.empty() ? PixelRect()
                  : PixelRect{r.x0 / align * align, r.y0 / align * align, up(r.x1, k.width), up(r.y1, k.height)});
  }
  return visible;
}

}  // namespace tessera
