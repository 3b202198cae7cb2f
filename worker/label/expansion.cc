#include "worker/label/expansion.h"

#include <algorithm>
#include <limits>

#include "common/base/parallel.h"
#include "worker/label/min_cut.h"

namespace tessera {
namespace {

constexpr int64_t kGrain = 4096;
constexpr int64_t kPartGrain = 16;
constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();

class Expansion {
 public:
  Expansion(const OpenField& open, int part_faces, std::vector<int32_t>* labels)
      : open_(open),
        part_faces_(part_faces),
        labels_(*labels),
        may_(open.size(), 0),
        most_(open.size(), 0),
        changed_(open.size(), 0),
        piece_(open.size(), kNone),
        index_(open.size()),
        bound_(open.size()) {
    ForFaces([&](int64_t f) {
      for (const OpenField::Link& link : open_[f]) most_[f] += link.weight;
    });
  }

  // True if it took any face. `turn` counts from 1; pieces in and around which nothing
  // changed since turn `last` are passed over, none if that is 0.
  bool Expand(int32_t alpha, int turn, int last) {
    FindCandidates(alpha);
    FindPieces();
    std::vector<uint8_t> took(groups_.size(), 0);
    ParallelFor(static_cast<int64_t>(groups_.size()) - 1, kPartGrain, [&](int64_t begin, int64_t end) {
      MinCut cut;
      for (int64_t g = begin; g < end; ++g) {
        for (uint32_t p = groups_[g]; p < groups_[g + 1]; ++p) {
          if (Stale(p, last)) took[g] |= Solve(alpha, turn, p, &cut);
        }
      }
    });
    for (const uint32_t f : candidates_) may_[f] = 0;
    for (const uint32_t f : faces_) piece_[f] = kNone;
    return std::find(took.begin(), took.end(), 1) != took.end();
  }

 private:
  template <typename Body>
  void ForFaces(const Body& body) const {
    ParallelFor(static_cast<int64_t>(labels_.size()), kGrain, [&](int64_t begin, int64_t end) {
      for (int64_t f = begin; f < end; ++f) body(f);
    });
  }

  float SwitchCost(size_t face, int32_t alpha) const {
    const float* cost = &open_.cost[face * open_.lanes];
    return cost[alpha] - cost[labels_[face]];
  }

  // What switching costs `face` on one edge if whoever may have alpha at its other end has it.
  float BestOnEdge(size_t face, const OpenField::Link& link, int32_t alpha) const {
    const int32_t other = labels_[link.face];
    if (other == alpha || may_[link.face]) return -link.weight;
    return other == labels_[face] ? link.weight : 0;
  }

  // Marks the faces that could gain by alpha if all the others that are marked had it. No other face is in the best
  // expansion.
  void FindCandidates(int32_t alpha) {
    ForFaces([&](int64_t f) { may_[f] = labels_[f] != alpha && SwitchCost(f, alpha) < most_[f]; });
    candidates_.clear();
    for (size_t f = 0; f < may_.size(); ++f) {
      if (may_[f]) candidates_.push_back(static_cast<uint32_t>(f));
    }
    out_.clear();
    ParallelFor(static_cast<int64_t>(candidates_.size()), kGrain, [&](int64_t begin, int64_t end) {
      for (int64_t c = begin; c < end; ++c) {
        const uint32_t f = candidates_[c];
        bound_[f] = SwitchCost(f, alpha);
        for (const OpenField::Link& link : open_[f]) bound_[f] += BestOnEdge(f, link, alpha);
      }
    });
    for (const uint32_t f : candidates_) {
      if (bound_[f] >= 0) Exclude(f);
    }
    while (!out_.empty()) {
      const uint32_t f = out_.back();
      out_.pop_back();
      for (const OpenField::Link& link : open_[f]) {
        const uint32_t g = link.face;
        if (!may_[g]) continue;
        bound_[g] += labels_[f] == labels_[g] ? 2 * link.weight : link.weight;
        if (bound_[g] >= 0) Exclude(g);
      }
    }
  }

  void Exclude(uint32_t face) {
    may_[face] = 0;
    out_.push_back(face);
  }

  // Groups of candidates that hang together, each cut into pieces of at most part_faces_.
  void FindPieces() {
    faces_.clear();
    pieces_.assign(1, 0);
    groups_.assign(1, 0);
    for (const uint32_t start : candidates_) {
      if (!may_[start] || piece_[start] != kNone) continue;
      size_t done = faces_.size();
      Enter(start);
      for (; done < faces_.size(); ++done) {
        for (const OpenField::Link& link : open_[faces_[done]]) {
          if (may_[link.face] && piece_[link.face] == kNone) Enter(link.face);
        }
      }
      pieces_.push_back(static_cast<uint32_t>(faces_.size()));
      groups_.push_back(static_cast<uint32_t>(pieces_.size() - 1));
    }
  }

  void Enter(uint32_t face) {
    if (faces_.size() - pieces_.back() == static_cast<size_t>(part_faces_)) {
      pieces_.push_back(static_cast<uint32_t>(faces_.size()));
    }
    piece_[face] = static_cast<uint32_t>(pieces_.size() - 1);
    index_[face] = static_cast<uint32_t>(faces_.size() - pieces_.back());
    faces_.push_back(face);
  }

  // Whether anything in or around the piece changed after turn `last`.
  bool Stale(uint32_t piece, int last) const {
    if (last == 0) return true;
    for (uint32_t i = pieces_[piece]; i < pieces_[piece + 1]; ++i) {
      if (changed_[faces_[i]] > last) return true;
      for (const OpenField::Link& link : open_[faces_[i]]) {
        if (changed_[link.face] > last) return true;
      }
    }
    return false;
  }

  // Faces of other pieces stay as they are.
  bool Solve(int32_t alpha, int turn, uint32_t piece, MinCut* cut) {
    const uint32_t begin = pieces_[piece], end = pieces_[piece + 1];
    cut->Reset(static_cast<int>(end - begin));
    for (uint32_t i = begin; i < end; ++i) {
      const uint32_t f = faces_[i];
      const int node = static_cast<int>(i - begin);
      double cost = SwitchCost(f, alpha);
      for (const OpenField::Link& link : open_[f]) {
        const bool same = labels_[f] == labels_[link.face];
        if (piece_[link.face] != piece) {
          cost += labels_[link.face] == alpha ? -link.weight : same ? link.weight : 0;
          continue;
        }
        // Different labels cost w as they are and nothing once both are alpha.
        if (!same) cost -= 0.5 * link.weight;
        if (f < link.face) {
          cut->AddPair(node, static_cast<int>(index_[link.face]), same ? link.weight : 0.5 * link.weight);
        }
      }
      cut->AddCost(node, cost);
    }
    cut->Solve();
    bool took = false;
    for (uint32_t i = begin; i < end; ++i) {
      if (!cut->In(static_cast<int>(i - begin))) continue;
      labels_[faces_[i]] = alpha;
      changed_[faces_[i]] = turn;
      took = true;
    }
    return took;
  }

  const OpenField& open_;
  const int part_faces_;
  std::vector<int32_t>& labels_;
  std::vector<uint8_t> may_;
  std::vector<float> most_;       // what the edges of a face weigh
  std::vector<int32_t> changed_;  // turn in which a face last changed
  std::vector<uint32_t> piece_, index_;
  std::vector<float> bound_;  // least that switching a candidate may cost
  std::vector<uint32_t> candidates_, out_;
  std::vector<uint32_t> faces_, pieces_,
      groups_;  // faces of piece p from pieces_[p], pieces of group g from groups_[g]
};

}  // namespace

void LowerByExpansions(const OpenField& open, int rounds, int part_faces, std::vector<int32_t>* labels) {
  if (labels->empty()) return;
  Expansion expansion(open, part_faces, labels);
  for (int round = 0, turn = 1; round < rounds; ++round) {
    bool changed = false;
    for (int32_t alpha = 0; alpha < open.classes; ++alpha, ++turn) {
      changed |= expansion.Expand(alpha, turn, std::max(0, turn - open.classes));
    }
    if (!changed) break;
  }
}

}  // namespace tessera
