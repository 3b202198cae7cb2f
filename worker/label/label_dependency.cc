#include "worker/label/label_dependency.h"

#include <algorithm>
#include <numeric>

#include "worker/label/undecided_field.h"

namespace tessera {
namespace {

// Adjacency lists of a directed graph's nodes.
struct Neighbours {
  std::vector<uint64_t> offsets;
  std::vector<uint32_t> nodes;
};

Neighbours NeighboursOf(size_t nodes, const std::vector<std::array<uint32_t, 2>>& pairs) {
  Neighbours neighbours;
  neighbours.offsets.assign(nodes + 1, 0);
  for (const auto& [from, to] : pairs) ++neighbours.offsets[from];
  std::partial_sum(neighbours.offsets.begin(), neighbours.offsets.end(), neighbours.offsets.begin());
  neighbours.nodes.resize(neighbours.offsets.back());
  for (const auto& [from, to] : pairs) neighbours.nodes[--neighbours.offsets[from]] = to;
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

// Flags the faces of all blocks within `turns` turns, and then `links` links, of a block with a flagged face.
void GrowByBlocks(const std::vector<std::array<uint32_t, 2>>& face_links, const std::vector<Cell>& cell, BlockGrid grid,
                  int turns, int links, std::vector<uint8_t>* flags) {
  std::vector<Cell> blocks(flags->size(), Cell{0, 0});
  for (size_t f = 0; f < cell.size(); ++f) blocks[f] = BlockOf(cell[f], grid);
  const CellGroups groups = GroupByCell(blocks);
  std::vector<std::array<uint32_t, 2>> block_turns, block_links;  // from a block to one that it reads
  for (const auto& [f, g] : face_links) {
    const uint32_t a = groups.group[f], b = groups.group[g];
    if (a == b) continue;
    const int a_colour = ColourOf(groups.cells[a], grid), b_colour = ColourOf(groups.cells[b], grid);
    if (a_colour != b_colour) block_turns.push_back(a_colour > b_colour ? std::array{a, b} : std::array{b, a});
    block_links.push_back({a, b});
    block_links.push_back({b, a});
  }
  std::vector<uint8_t> block_flags(groups.cells.size(), 0);
  for (size_t f = 0; f < flags->size(); ++f) {
    if ((*flags)[f]) block_flags[groups.group[f]] = 1;
  }
  Grow(NeighboursOf(block_flags.size(), block_turns), turns, &block_flags);
  Grow(NeighboursOf(block_flags.size(), block_links), links, &block_flags);
  for (size_t f = 0; f < flags->size(); ++f) (*flags)[f] = block_flags[groups.group[f]];
}

}  // namespace

LabelDependencyRadius LabelDependencyRadiusOf(const SolverOptions& options) {
  const int message_rings = kDecideRounds + 1 + std::max(0, options.iterations);
  constexpr int kTurns = kColours - 1;
  return {.odd_turns = kTurns, .odd_rings = 1, .even_turns = kTurns, .even_links = 1, .rings = message_rings + 1};
}

std::vector<uint8_t> FacesInDependencyRadius(const std::vector<std::array<uint32_t, 2>>& face_links,
                                             const std::vector<Cell>& cell, const std::vector<uint8_t>& core,
                                             const LabelDependencyRadius& radius) {
  std::vector<std::array<uint32_t, 2>> both_ways = face_links;
  both_ways.reserve(2 * face_links.size());
  for (const auto& [a, b] : face_links) both_ways.push_back({b, a});
  const Neighbours neighbours = NeighboursOf(core.size(), both_ways);
  std::vector<uint8_t> faces = core;
  GrowByBlocks(face_links, cell, BlockGrid::kOdd, radius.odd_turns, 0, &faces);
  Grow(neighbours, radius.odd_rings, &faces);
  GrowByBlocks(face_links, cell, BlockGrid::kEven, radius.even_turns, radius.even_links, &faces);
  Grow(neighbours, radius.rings, &faces);
  return faces;
}

}  // namespace tessera
