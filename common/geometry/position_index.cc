#include "common/geometry/position_index.h"

#include <bit>

#include "common/base/random.h"

namespace tessera {
namespace {

uint64_t HashOfPosition(const Eigen::Vector3d& position) {
  uint64_t hash = 0;
  for (int k = 0; k < 3; ++k) hash = MixBits(hash ^ std::bit_cast<uint64_t>(position[k] + 0.0));  // -0 + 0 is 0
  return hash;
}

}  // namespace

uint32_t PositionIndex::NumberOf(const Eigen::Vector3d& position) {
  if (2 * (positions_.size() + 1) > slots_.size()) Grow();
  const size_t mask = slots_.size() - 1;
  size_t slot = HashOfPosition(position) & mask;
  while (slots_[slot] != 0 && positions_[slots_[slot] - 1] != position) slot = (slot + 1) & mask;
  if (slots_[slot] == 0) {
    positions_.push_back(position);
    slots_[slot] = static_cast<uint32_t>(positions_.size());
  }
  return slots_[slot] - 1;
}

void PositionIndex::Grow() {
  slots_.assign(slots_.empty() ? 64 : 2 * slots_.size(), 0);
  const size_t mask = slots_.size() - 1;
  for (size_t number = 0; number < positions_.size(); ++number) {
    size_t slot = HashOfPosition(positions_[number]) & mask;
    while (slots_[slot] != 0) slot = (slot + 1) & mask;
    slots_[slot] = static_cast<uint32_t>(number + 1);
  }
}

}  // namespace tessera
