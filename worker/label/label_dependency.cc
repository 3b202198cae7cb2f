#include "worker/label/label_dependency.h"

#include <algorithm>
#include <numeric>

#include "worker/label/undecided_field.h"

namespace tessera {
namespace {

// Adjacency lists of a graph's nodes.
struct Neighbours {
  std::vector<uint64_t> offsets;
  std::vector<uint32_t> nodes;
};

Neighbours NeighboursOf(size_t nodes, const std::vector<std::array<uint32_t, 2>>& pairs) {
  Neighbours neighbours;
  neighbours.offsets.assign(nodes + 1, 0);
  for (const auto& [a, b] : pairs) {
    ++neighbours.offsets[a];
    ++neighbours.offsets[b];
  }
  std::partial_sum(neighbours.offsets.begin(), neighbours.offsets.end(), neighbours.offsets.begin());
  neighbours.nodes.resize(neighbours.offsets.back());
  for (const auto& [a, b] : pairs) {
    neighbours.nodes[--neighbours.offsets[a]] = b;
    neighbours.nodes[--neighbours.offsets[b]] = a;
  }
  return neighbours;
}

// Dilates the flags by `steps`.
void Grow(const Neighbours& neighbours, int steps, std::vector<uint8_t>* flags) {
  std::vector<uint32_t> rim, next;
  for (uint32_t i = 0; i < flags->size(); ++i) {
    if ((*flags)[i]) rim.push_back(i);
  }
  for (int step = 0; step < steps && !rim.empty(); ++step) {
    next.clear();
    for (const uint32_t i : rim) {
      for (uint64_t n = neighbours.offsets[i]; n < neighbours.offsets[i + 1]; ++n) {
        uint8_t& flag = (*flags)[neighbours.nodes[n]];
        if (flag) continue;
        flag = 1;
        next.push_back(neighbours.nodes[n]);
      }
    }
    rim.swap(next);
  }
}

// Flags the faces of all blocks within `links` block links of a block with a flagged face.
void GrowByBlocks(const std::vector<std::array<uint32_t, 2>>& face_links, const std::vector<Cell>& cell, BlockGrid grid,
                  int links, std::vector<uint8_t>* flags) {
  std::vector<Cell> blocks(flags->size(), Cell{0, 0});
  for (size_t f = 0; f < cell.size(); ++f) blocks[f] = BlockOf(cell[f], grid);
  const CellGroups groups = GroupByCell(blocks);
  std::vector<std::array<uint32_t, 2>> block_links;
  for (const auto& [a, b] : face_links) {
    if (groups.group[a] != groups.group[b]) block_links.push_back({groups.group[a], groups.group[b]});
  }
  std::vector<uint8_t> block_flags(groups.cells.size(), 0);
  for (size_t f = 0; f < flags->size(); ++f) {
    if ((*flags)[f]) block_flags[groups.group[f]] = 1;
  }
  Grow(NeighboursOf(block_flags.size(), block_links), links, &block_flags);
  for (size_t f = 0; f < flags->size(); ++f) (*flags)[f] = block_flags[groups.group[f]];
}

}  // namespace

LabelDependencyRadius LabelDependencyRadiusOf(const SolverOptions& options) {
  const int message_rings = kDecideRounds + 1 + std::max(0, options.iterations);
  return {.odd_links = 3, .odd_rings = 1, .even_links = 4, .rings = message_rings + 1};
}

std::vector<uint8_t> FacesInDependencyRadius(const std::vector<std::array<uint32_t, 2>>& face_links,
                                             const std::vector<Cell>& cell, const std::vector<uint8_t>& core,
                                             const LabelDependencyRadius& radius) {
  const Neighbours neighbours = NeighboursOf(core.size(), face_links);
  std::vector<uint8_t> faces = core;
  GrowByBlocks(face_links, cell, BlockGrid::kOdd, radius.odd_links, &faces);
  Grow(neighbours, radius.odd_rings, &faces);
  GrowByBlocks(face_links, cell, BlockGrid::kEven, radius.even_links, &faces);
  Grow(neighbours, radius.rings, &faces);
  return faces;
}

}  // namespace tessera
