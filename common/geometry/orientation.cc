#include "common/geometry/orientation.h"

#include <algorithm>
#include <array>
#include <memory>
#include <vector>

#include "common/base/parallel.h"
#include "common/geometry/coarse_mesh.h"
#include "common/geometry/ray_caster.h"

namespace tessera {
namespace {

constexpr int64_t kVoteSamples = 200000, kMaxSamplesOfPiece = 256;
constexpr int kMaxVotesOfFace = 8, kMinVotes = 3;
constexpr int64_t kSmallPieceFaces = 100;
constexpr double kSmallPiece_px2 = 25;
constexpr int64_t kVoteClusters = 1 << 18;

struct Piece {
  uint32_t root = 0;
  int64_t faces = 0, opposed = 0;           // opposed: to the root
  int64_t stride = 1;                       // between sampled faces
  int64_t fronts = 0, backs = 0;            // votes for and against the orientation of the root
  std::array<int32_t, 2> views = {-1, -1};  // two that see it
  double area_px2 = 0;                      // of the samples, at the best scale
};

struct Sample {
  uint32_t face = 0, piece = 0;
  bool is_opposed = false;
  int fronts = 0, backs = 0;
  std::array<int32_t, 2> views = {-1, -1};
  double area_px2 = 0;
};

class Visibility {
 public:
  static StatusOr<Visibility> Create(const MeshSpans& mesh, std::span<const Viewpoint> views,
                                     const std::string& scratch_folder, size_t max_faces_for_rays) {
    Visibility out(views);
    if (mesh.faces.size() <= max_faces_for_rays) {
      out.caster_ = std::make_unique<RayCaster>(mesh);
      return out;
    }
    TESSERA_ASSIGN_OR_RETURN(const CoarseMesh coarse, CoarsenMesh(mesh, kVoteClusters, scratch_folder));
    out.caster_ = std::make_unique<RayCaster>(coarse.mesh);
    out.error_m_ = coarse.error_m;
    return out;
  }

  void Vote(const MeshSpans& mesh, Sample* sample) const {
    const Eigen::Vector3d middle = mesh.Centroid(sample->face);
    const Eigen::Vector3d cross = FaceCross(mesh, sample->face);
    for (size_t v = 0; v < views_.size() && sample->fronts + sample->backs < kMaxVotesOfFace; ++v) {
      const Eigen::Vector3d projected = views_[v].Homogeneous(middle), ray = middle - views_[v].centre;
      if (!views_[v].InImage(projected)) continue;
      // The ray ends before the face by 1/1000 of the distance, so that the face and its neighbours do not occlude it.
      if (caster_->Occluded(views_[v].centre, middle, 1e-3 * ray.norm() + 2 * error_m_)) continue;
      const bool is_front = (cross.dot(ray) < 0) != sample->is_opposed;
      ++(is_front ? sample->fronts : sample->backs);
      if (sample->views[0] < 0) {
        sample->views[0] = static_cast<int32_t>(v);
      } else if (sample->views[1] < 0) {
        sample->views[1] = static_cast<int32_t>(v);
      }
      sample->area_px2 = std::max(sample->area_px2,
                                  0.5 * cross.norm() * views_[v].focal_product_px2 / (projected.z() * projected.z()));
    }
  }

 private:
  explicit Visibility(std::span<const Viewpoint> views) : views_(views) {}
  std::span<const Viewpoint> views_;
  std::unique_ptr<RayCaster> caster_;
  double error_m_ = 0;
};

void AddVotes(const Sample& sample, Piece* piece) {
  piece->fronts += sample.fronts;
  piece->backs += sample.backs;
  piece->area_px2 += sample.area_px2;
  for (const int32_t view : sample.views) {
    if (view < 0 || view == piece->views[0] || view == piece->views[1]) continue;
    if (piece->views[0] < 0) {
      piece->views[0] = view;
    } else if (piece->views[1] < 0) {
      piece->views[1] = view;
    }
  }
}

bool RootIsTurned(const Piece& piece) {
  const auto wins = [](int64_t votes, int64_t others) { return votes >= kMinVotes && votes > 2 * others; };
  if (wins(piece.backs, piece.fronts)) return true;
  if (wins(piece.fronts, piece.backs)) return false;
  return 2 * piece.opposed > piece.faces;
}

bool IsSmall(const Piece& piece) {
  return piece.faces <= kSmallPieceFaces &&
         (piece.views[1] < 0 || piece.area_px2 * static_cast<double>(piece.stride) < kSmallPiece_px2);
}

}  // namespace

FaceOrientation::FaceOrientation(std::span<uint32_t> links) : links_(links) {
  for (uint32_t f = 0; f < links_.size(); ++f) links_[f] = 2 * f;
}

FaceOrientation::Root FaceOrientation::Find(uint32_t face) const {
  Root root = {face, 0};
  while (links_[root.face] / 2 != root.face) {
    const uint32_t link = links_[root.face];
    root = {link / 2, root.parity ^ (link & 1)};
  }
  return root;
}

void FaceOrientation::Join(uint32_t face, uint32_t other, bool same_direction) {
  Root a = Find(face), b = Find(other);
  for (const auto& [start, root] : {std::pair(face, a), std::pair(other, b)}) {  // shorten the paths
    uint32_t f = start, parity = root.parity;
    while (f != root.face) {
      const uint32_t link = links_[f];
      links_[f] = 2 * root.face + parity;
      parity ^= link & 1;
      f = link / 2;
    }
  }
  if (a.face == b.face) return;
  if (a.face > b.face) std::swap(a, b);
  links_[b.face] = 2 * a.face + (a.parity ^ b.parity ^ (same_direction ? 1 : 0));
}

bool FaceOrientation::IsTurned(uint32_t face) const {
  if (links_[face] == kExcluded) return false;
  const Root root = Find(face);
  return (root.parity ^ (links_[root.face] & 1)) != 0;
}

StatusOr<FaceOrientation::Result> FaceOrientation::Decide(const MeshSpans& mesh, std::span<const Viewpoint> views,
                                                          const std::string& scratch_folder,
                                                          size_t max_faces_for_rays) {
  const auto faces = static_cast<uint32_t>(links_.size());
  // The links lead directly to the roots from here on, since a parent has a lower index.
  for (uint32_t f = 0; f < faces; ++f) {
    if (links_[f] == kExcluded || links_[f] / 2 == f) continue;
    const uint32_t parent = links_[links_[f] / 2];
    links_[f] = 2 * (parent / 2) + ((parent ^ links_[f]) & 1);
  }
  std::vector<Piece> pieces;
  for (uint32_t f = 0; f < faces; ++f) {
    if (links_[f] / 2 == f) pieces.push_back({.root = f});
  }
  size_t last = 0;  // neighbours are mostly of one piece
  const auto piece_of = [&](uint32_t f) {
    const uint32_t root = links_[f] / 2;
    if (pieces[last].root != root) {
      last = static_cast<size_t>(
          std::lower_bound(pieces.begin(), pieces.end(), root, [](const Piece& p, uint32_t r) { return p.root < r; }) -
          pieces.begin());
    }
    return last;
  };
  for (uint32_t f = 0; f < faces; ++f) {
    if (links_[f] == kExcluded) continue;
    Piece& piece = pieces[piece_of(f)];
    ++piece.faces;
    piece.opposed += links_[f] & 1;
  }
  if (!views.empty() && !pieces.empty()) {
    const int64_t most = std::clamp<int64_t>(kVoteSamples / static_cast<int64_t>(pieces.size()), 1, kMaxSamplesOfPiece);
    for (Piece& piece : pieces) piece.stride = (piece.faces + most - 1) / most;
    std::vector<Sample> samples;
    std::vector<int64_t> next(pieces.size(), 0);
    for (uint32_t f = 0; f < faces; ++f) {
      if (links_[f] == kExcluded) continue;
      const size_t p = piece_of(f);
      if (next[p]++ % pieces[p].stride != 0) continue;
      samples.push_back({.face = f, .piece = static_cast<uint32_t>(p), .is_opposed = (links_[f] & 1) != 0});
    }
    TESSERA_ASSIGN_OR_RETURN(const Visibility visibility,
                             Visibility::Create(mesh, views, scratch_folder, max_faces_for_rays));
    ParallelForEach(samples.size(), 64, [&](size_t i) { visibility.Vote(mesh, &samples[i]); });
    for (const Sample& sample : samples) AddVotes(sample, &pieces[sample.piece]);
  }
  Result result;
  const auto count = [](DefectCount* defect, uint32_t first) {
    if (defect->count++ == 0) defect->first = first;
  };
  for (const Piece& piece : pieces) {
    if (RootIsTurned(piece)) links_[piece.root] |= 1;
    if (!views.empty() && IsSmall(piece)) count(&result.small_pieces, piece.root);
  }
  for (uint32_t f = 0; f < faces; ++f) {
    if (IsTurned(f)) count(&result.turned_faces, f);
  }
  return result;
}

}  // namespace tessera
