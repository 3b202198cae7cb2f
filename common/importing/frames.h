// Where an imported block lies: from the coordinates of its source to those of the scene, and back.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/blocks/block.h"
#include "common/geodesy/frame.h"
#include "common/geodesy/reference_system.h"

namespace tessera {

// A map projection is not metric: its scale (.9996 in UTM), convergence and the Earth's curvature bend what a program
// adjusted in space. kGrid keeps coordinates as they are, for programs that adjust in the grid as if it were Cartesian.
// kTrue takes them to one east-north-up frame at the block's centre, for programs that adjust in space and write grid
// coordinates.
enum class FrameChoice { kGrid, kTrue };

struct FrameOptions {
  std::string crs;  // instead of the one that the source names; empty: that of the source
  HeightOptions heights;
};

// Coordinates of one source: a reference system, and what the source subtracted from its coordinates.
struct SourceCoordinates {
  std::string crs;                                   // as ImportedBlock::crs
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();  // in the units of the system
};

// The map between the coordinates of a source, without offset, and those of a scene. Safe to call concurrently; calls
// wait for each other.
class SceneMap {
 public:
  // `near`: a point of the source, without offset, around which PROJ's operations are chosen. INVALID_ARGUMENT if a
  // system is not known, cannot be converted or turns left into right; if just one side is local; errors of
  // ReferenceSystem.
  static StatusOr<SceneMap> Open(const SourceCoordinates& source, const Crs& scene, const HeightOptions& heights,
                                 const Eigen::Vector3d& near);
  // With the scene's Crs for a choice of the frame: kGrid if the system has a Crs for it (ReferenceSystem::GridCrs),
  // else, and for kTrue, east-north-up at `near`, at height 0. East-north-up and local sources stay as they are.
  // kGrid of angles and geocentric coordinates is kTrue; of a system without EPSG code it is INVALID_ARGUMENT.
  static StatusOr<SceneMap> Choose(const SourceCoordinates& source, FrameChoice choice, const HeightOptions& heights,
                                   const Eigen::Vector3d& near);

  const Crs& scene() const { return scene_; }
  const ReferenceSystem& source() const { return source_; }
  // Whether the map is a translation, besides units.
  bool keeps_coordinates() const { return !target_; }

  // In place. INVALID_ARGUMENT names a point without image. A round trip is exact to 1e-6 m.
  Status SceneFromSource(std::span<Eigen::Vector3d> points) const;
  Status SourceFromScene(std::span<Eigen::Vector3d> points) const;
  // The rotation nearest to the map's Jacobian at a point of the source: it takes directions in the source (east, north
  // and up for angles; x, y and z for geocentric coordinates) to directions in the scene.
  StatusOr<Eigen::Matrix3d> SceneFromSourceRotation(const Eigen::Vector3d& point) const;

 private:
  SceneMap(ReferenceSystem source, std::optional<ReferenceSystem> target, const Crs& scene,
           const Eigen::Vector3d& offset);

  ReferenceSystem source_;
  std::optional<ReferenceSystem> target_;  // none: coordinates are kept
  Crs scene_;
  Eigen::Vector3d offset_;
};

struct PlacedBlock {
  ImportedBlock block;      // in scene coordinates; `crs` is empty and `offset` zero
  SceneMap map;             // from the coordinates of the source's block
  bool true_frame = false;  // what was done: east-north-up (true) or coordinates as they are
};

// Takes a block to the coordinates of a scene. Positions are mapped exactly. Each pose is turned by the rotation of its
// own centre: programs that adjust in space state a pose in the axes of the map at the camera. Adds what was applied to
// the block's `conventions`. Local blocks (without a system) stay as they are.
StatusOr<PlacedBlock> PlaceBlock(const ImportedBlock& block, FrameChoice choice, const FrameOptions& options,
                                 Warnings* warnings);

}  // namespace tessera
