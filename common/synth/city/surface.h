// Labelled, textured triangle surfaces of the city, and the solids for the start mesh's occupancy.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/synth/city/plan.h"

namespace tessera {

enum class Material : uint8_t {
  kGroundCover,
  kPlaster,
  kBrick,
  kConcrete,
  kPlainWall,
  kWindow,
  kDoor,
  kRoofTiles,
  kRoofMetal,
  kRoofGravel,
  kRoofPlain,
  kFoliage,
  kBark
};

// Texture parameters of a face. `u`, `v`: unit axes of the surface, world frame; texture coordinates are metres along
// them from `origin`. `extent_m`: size of a window or door; for the inside of blocks, x is the paved share.
struct SurfacePatch {
  Material material = Material::kGroundCover;
  uint32_t seed = 0;
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  Eigen::Vector3d u = Eigen::Vector3d::UnitX();
  Eigen::Vector3d v = Eigen::Vector3d::UnitY();
  Eigen::Vector2f extent_m = {1, 1};
  Eigen::Vector3f albedo = {0.5f, 0.5f, 0.5f};  // linear RGB
};

// Low shrubs on ground or on a roof.
SurfacePatch PlantingPatch(uint32_t seed, const Eigen::Vector3d& origin);

// A labelled mesh with a texture patch per face.
struct TexturedSurface {
  TriangleMesh mesh;
  std::vector<uint32_t> patch_of_face;
  std::vector<SurfacePatch> patches;

  // Appends `other`; both are in the world frame.
  void Append(const TexturedSurface& other);
};

// A convex solid {p : n·p <= offset for all planes}, for occupancy. Each plane has the class of its side.
struct ConvexSolid {
  struct Plane {
    Eigen::Vector3d normal;
    double offset;
    int32_t label;
  };
  std::vector<Plane> planes;
  Eigen::AlignedBox3d box;

  // Signed distance to the boundary inside (negative) and near faces; a lower bound elsewhere.
  double Distance(const Eigen::Vector3d& p) const {
    double best = -1e30;
    for (const Plane& plane : planes) best = std::max(best, plane.normal.dot(p) - plane.offset);
    return best;
  }
};

// All objects on a block's ground.
struct BlockSolids {
  TexturedSurface surface;
  std::vector<ConvexSolid> solids;
  std::vector<TreeSpec> trees;
};

// Builds solids in a local frame (rotated about z, translated) and appends them to a block. Equal vertices of one solid
// are merged, so a solid whose faces meet edge to edge is a closed manifold.
class SolidBuilder {
 public:
  SolidBuilder(BlockSolids& block, const Eigen::Vector3d& origin, double yaw_rad)
      : block_(block),
        origin_(origin),
        rotation_(Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix()) {}

  // Starts a new solid; vertices are merged only within it.
  void Begin() { index_.clear(); }
  // Adds a patch whose axes are in the builder's frame; returns its index.
  uint32_t Patch(Material material, uint32_t seed, const Eigen::Vector3f& albedo, const Eigen::Vector3d& origin,
                 const Eigen::Vector3d& u, const Eigen::Vector3d& v, const Eigen::Vector2f& extent_m = {1, 1});
  // Corners counter-clockwise seen from outside.
  void Triangle(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c, int32_t label,
                uint32_t patch);
  void Quad(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c, const Eigen::Vector3d& d,
            int32_t label, uint32_t patch);

  struct Finish {
    Material material = Material::kPlaster;
    Eigen::Vector3f albedo = {0.5f, 0.5f, 0.5f};
    int32_t label = kFacade;
  };
  // Adds a closed box; `occupies`: also adds it to the occupancy.
  void Box(const Eigen::Vector3d& low, const Eigen::Vector3d& high, const Finish& side, const Finish& top,
           uint32_t seed, bool occupies = true);
  // Adds a convex solid for occupancy: planes through the given points with outward normals, builder's frame.
  struct LocalPlane {
    Eigen::Vector3d point, normal;
    int32_t label;
  };
  void Occupy(const std::vector<LocalPlane>& planes, const std::vector<Eigen::Vector3d>& corners);

  Eigen::Vector3d ToWorld(const Eigen::Vector3d& p) const { return origin_ + rotation_ * p; }

 private:
  uint32_t Vertex(const Eigen::Vector3d& p);

  BlockSolids& block_;
  Eigen::Vector3d origin_;
  Eigen::Matrix3d rotation_;
  std::map<std::array<int64_t, 3>, uint32_t> index_;
};

// Appends a building: body with reveals, balconies and cornices; roof with dormers, chimneys or parapets.
void BuildBuilding(const BuildingSpec& spec, BlockSolids& block);

// Appends a tree: trunk and rough crown.
void BuildTree(const TreeSpec& spec, BlockSolids& block);

// Outlines seen from above, counter-clockwise, in plan coordinates: of a roof with its eaves (without balconies,
// cornices and pilasters), and of a tree's crown.
std::vector<Eigen::Vector2d> RoofOutline(const BuildingSpec& spec);
std::vector<Eigen::Vector2d> CrownOutline(const TreeSpec& spec);

// Approximate signed distance to a crown and the space below it; negative inside.
double CrownDistance(const TreeSpec& spec, const Eigen::Vector3d& p);

// All objects of a block, without its ground.
BlockSolids BuildBlock(const CityPlan& plan, int column, int row);

}  // namespace tessera
