#include "worker/tile/repair_tile.h"

#include <cmath>
#include <utility>

#include "common/base/parallel.h"
#include "worker/city/pick.h"
#include "worker/tile/regions.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

constexpr int64_t kPositionGrain = 1 << 14;
constexpr float kCertainCost = 10;  // of another label than the one that is carried through

// Where each face may lie between two places, with room for what FaceBoxes rounds.
std::vector<Eigen::AlignedBox3d> SweptBoxes(const std::vector<Triangle>& faces, const std::vector<Vector3d>& from,
                                            const std::vector<Vector3d>& to) {
  std::vector<Eigen::AlignedBox3d> boxes(faces.size());
  for (size_t f = 0; f < boxes.size(); ++f) {
    for (const uint32_t v : faces[f]) boxes[f].extend(from[v]).extend(to[v]);
    const Vector3d room = 1e-6 * (boxes[f].min().cwiseAbs().cwiseMax(boxes[f].max().cwiseAbs()) + Vector3d::Ones());
    boxes[f] = {boxes[f].min() - room, boxes[f].max() + room};
  }
  return boxes;
}

}  // namespace

StatusOr<CoreRepair> Repair(TileWorkspace& work, RepairStage stage, const TileRefineOptions& options,
                            TileSnapshot* snapshot) {
  const TilePackage& package = work.package();
  CoreRepair repaired;
  if (package.has_pairs) {
    const RegionMesh& region = work.region(kRepairRegion);
    RegionRepair* const kept = work.whole() ? nullptr : work.KeptRepair(options.step);
    std::vector<Vector3d> good, positions = Pick(snapshot->positions, region.vertices);
    if (stage == RepairStage::kLevel) {
      if (snapshot->level_start.empty()) return absl::DataLossError("repair: the states have no level start");
      good = Pick(snapshot->level_start, region.vertices);
    } else {
      if (work.whole()) {
        good = work.SolveStepper(*snapshot, options).guard().RepairedStart();
      } else if (kept != nullptr) {
        good = kept->guard.RepairedStart();
      } else {
        good =
            MotionGuard(region.surface, region.boundary, MakeMotionLimits(options.step, package.gsd_m)).RepairedStart();
      }
      // Frozen vertices stay where they are.
      const std::vector<uint8_t> frozen = Pick(snapshot->frozen_vertices, region.vertices);
      for (size_t v = 0; v < frozen.size(); ++v) {
        if (frozen[v]) good[v] = positions[v];
      }
      if (stage == RepairStage::kStart) positions.swap(good);
    }
    if (work.whole()) {
      // With the guard and the boxes that the stepper keeps from one level to the next.
      const SurfaceRepair::Result all = work.SolveStepper(*snapshot, options).Repair(good, &positions);
      repaired = {all.changed_vertices, static_cast<int64_t>(all.left.size())};
    } else {
      std::vector<uint8_t> core;
      for (const uint32_t f : region.faces) core.push_back(package.regions[f] & kCoreRegion);
      repaired = kept != nullptr ? RepairWithKept(*kept, region, core, options.step, good, &positions)
                                 : RepairCore(region, core, package.gsd_m, options.step, good, &positions);
    }
    ParallelForEach(positions.size(), kPositionGrain,
                    [&](size_t v) { snapshot->positions[region.vertices[v]] = positions[v]; });
    if (kept == nullptr) work.Forget(kRepairRegion);
  }
  snapshot->level_start.clear();
  snapshot->last_step.clear();
  FillConfidence(package, snapshot);
  return repaired;
}

CoreRepair RepairWithKept(RegionRepair& kept, const RegionMesh& region, const std::vector<uint8_t>& core,
                          const StepperOptions& options, const std::vector<Vector3d>& good,
                          std::vector<Vector3d>* positions) {
  RepairDependencyRadius radius = RepairDependencyRadiusOf(options);
  radius.start_rings = 0;  // the guard has the smoothed start of the whole region
  const std::vector<uint8_t> tested = FacesForRepair(region.mesh(), kept.guard.faces_of_vertex(), core, radius,
                                                     SweptBoxes(region.mesh().faces, good, *positions));
  const auto keeps_facing = [&](uint32_t face, const auto& from, const auto& to) {
    return kept.guard.KeepsOrientation(face, from, to);
  };
  const SurfaceRepair::Result repaired = kept.repair.Run(good, keeps_facing, positions, tested);
  CoreRepair out;
  out.changed_vertices = repaired.changed_vertices;
  for (const uint32_t f : repaired.left) out.left_faces += core[f] != 0;
  return out;
}

CoreRepair RepairCore(const RegionMesh& region, const std::vector<uint8_t>& core, double gsd_m,
                      const StepperOptions& options, const std::vector<Vector3d>& good,
                      std::vector<Vector3d>* positions) {
  const TriangleMesh& all = region.mesh();
  const CsrRows& faces_of_vertex = region.surface.faces_of_vertex();
  const std::vector<uint8_t> read = FacesForRepair(all, faces_of_vertex, core, RepairDependencyRadiusOf(options),
                                                   SweptBoxes(all.faces, good, *positions));
  PickedMesh part = PickFlagged(all, read);
  std::vector<uint8_t> boundary;
  for (const uint32_t v : part.vertices) {
    bool some_missing = !region.boundary.empty() && region.boundary[v] != 0;
    for (const uint32_t f : faces_of_vertex[v]) some_missing |= !read[f];
    boundary.push_back(some_missing);
  }
  const StartSurface surface(std::move(part.mesh));
  const MotionGuard guard(surface, boundary, MakeMotionLimits(options, gsd_m));
  const auto keeps_facing = [&](uint32_t face, const auto& from, const auto& to) {
    return guard.KeepsOrientation(face, from, to);
  };
  std::vector<Vector3d> moved = Pick(*positions, part.vertices);
  const SurfaceRepair::Result repaired =
      SurfaceRepair(surface.mesh(), guard.faces_of_vertex()).Run(Pick(good, part.vertices), keeps_facing, &moved);
  for (size_t v = 0; v < moved.size(); ++v) (*positions)[part.vertices[v]] = moved[v];
  CoreRepair out;
  out.changed_vertices = repaired.changed_vertices;
  for (const uint32_t f : repaired.left) out.left_faces += core[part.faces[f]] != 0;
  return out;
}

float CarriedConfidence(int classes, int32_t label) {
  return label < 0 ? 0.0f : 1 / (1 + static_cast<float>(classes - 1) * std::exp(-kCertainCost));
}

void FillConfidence(const TilePackage& package, TileSnapshot* snapshot) {
  if (!snapshot->confidence.empty()) return;
  for (const int32_t label : snapshot->labels) {
    snapshot->confidence.push_back(CarriedConfidence(static_cast<int>(package.classes.size()), label));
  }
}

}  // namespace tessera
