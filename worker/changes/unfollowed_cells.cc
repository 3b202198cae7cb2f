#include "worker/changes/unfollowed_cells.h"

namespace tessera {

UnfollowedCells::UnfollowedCells(const CellRect& cells, const std::vector<ChangeArea>& areas)
    : cells_(cells), area_(static_cast<size_t>(cells.x1 - cells.x0) * (cells.y1 - cells.y0), -1) {
  const auto for_each = [&](const auto& visit) {
    for (size_t a = 0; a < areas.size(); ++a) {
      if (!areas[a].followed || *areas[a].followed) continue;
      for (const Eigen::Vector2i& cell : areas[a].cells) visit(cell, static_cast<int32_t>(a));
    }
  };
  for_each([&](const Eigen::Vector2i& cell, int32_t area) { area_[Index(cell)] = area; });
  for_each([&](const Eigen::Vector2i& cell, int32_t area) {
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dx = -1; dx <= 1; ++dx) {
        const Eigen::Vector2i beside = cell + Eigen::Vector2i(dx, dy);
        if (AreaOf(beside) < 0 && cells_.Contains(beside)) area_[Index(beside)] = area;
      }
    }
  });
}

size_t UnfollowedCells::Index(const Eigen::Vector2i& cell) const {
  return static_cast<size_t>(cell.y() - cells_.y0) * (cells_.x1 - cells_.x0) + (cell.x() - cells_.x0);
}

int UnfollowedCells::AreaOf(const Eigen::Vector2i& cell) const {
  return cells_.Contains(cell) ? area_[Index(cell)] : -1;
}

bool UnfollowedCells::AnyIn(const CellRect& part) const {
  for (int y = part.y0; y < part.y1; ++y) {
    for (int x = part.x0; x < part.x1; ++x) {
      if (AreaOf({x, y}) >= 0) return true;
    }
  }
  return false;
}

}  // namespace tessera
