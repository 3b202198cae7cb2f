#include "common/synth/city/surface.h"

#include <cmath>

namespace tessera {

SurfacePatch PlantingPatch(uint32_t seed, const Eigen::Vector3d& origin) {
  SurfacePatch patch;
  patch.material = Material::kFoliage;
  patch.seed = seed;
  patch.origin = origin;
  patch.albedo = {0.1f, 0.21f, 0.05f};
  return patch;
}

void TexturedSurface::Append(const TexturedSurface& other) {
  const uint32_t first_vertex = static_cast<uint32_t>(mesh.vertices.size());
  const uint32_t first_patch = static_cast<uint32_t>(patches.size());
  mesh.vertices.insert(mesh.vertices.end(), other.mesh.vertices.begin(), other.mesh.vertices.end());
  for (const tessera::Triangle& t : other.mesh.faces) {
    mesh.faces.push_back({t[0] + first_vertex, t[1] + first_vertex, t[2] + first_vertex});
  }
  mesh.labels.insert(mesh.labels.end(), other.mesh.labels.begin(), other.mesh.labels.end());
  for (uint32_t patch : other.patch_of_face) patch_of_face.push_back(patch + first_patch);
  patches.insert(patches.end(), other.patches.begin(), other.patches.end());
}

uint32_t SolidBuilder::Vertex(const Eigen::Vector3d& p) {
  const std::array<int64_t, 3> key = {std::llround(p.x() * 1e5), std::llround(p.y() * 1e5), std::llround(p.z() * 1e5)};
  const auto [place, fresh] = index_.try_emplace(key, static_cast<uint32_t>(block_.surface.mesh.vertices.size()));
  if (fresh) block_.surface.mesh.vertices.push_back(ToWorld(p));
  return place->second;
}

uint32_t SolidBuilder::Patch(Material material, uint32_t seed, const Eigen::Vector3f& albedo,
                             const Eigen::Vector3d& origin, const Eigen::Vector3d& u, const Eigen::Vector3d& v,
                             const Eigen::Vector2f& extent_m) {
  block_.surface.patches.push_back({material, seed, ToWorld(origin), rotation_ * u, rotation_ * v, extent_m, albedo});
  return static_cast<uint32_t>(block_.surface.patches.size()) - 1;
}

void SolidBuilder::Triangle(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c, int32_t label,
                            uint32_t patch) {
  TriangleMesh& mesh = block_.surface.mesh;
  mesh.faces.push_back({Vertex(a), Vertex(b), Vertex(c)});
  mesh.labels.push_back(label);
  block_.surface.patch_of_face.push_back(patch);
}

void SolidBuilder::Quad(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                        const Eigen::Vector3d& d, int32_t label, uint32_t patch) {
  Triangle(a, b, c, label, patch);
  Triangle(a, c, d, label, patch);
}

void SolidBuilder::Occupy(const std::vector<LocalPlane>& planes, const std::vector<Eigen::Vector3d>& corners) {
  ConvexSolid solid;
  for (const LocalPlane& plane : planes) {
    const Eigen::Vector3d normal = (rotation_ * plane.normal).normalized();
    solid.planes.push_back({normal, normal.dot(ToWorld(plane.point)), plane.label});
  }
  for (const Eigen::Vector3d& corner : corners) solid.box.extend(ToWorld(corner));
  block_.solids.push_back(std::move(solid));
}

void SolidBuilder::Box(const Eigen::Vector3d& low, const Eigen::Vector3d& high, const Finish& side, const Finish& top,
                       uint32_t seed, bool occupies) {
  Begin();
  const auto at = [&](int corner) {
    return Eigen::Vector3d(corner & 1 ? high.x() : low.x(), corner & 2 ? high.y() : low.y(),
                           corner & 4 ? high.z() : low.z());
  };
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX(), y = Eigen::Vector3d::UnitY(), z = Eigen::Vector3d::UnitZ();
  const uint32_t along_x = Patch(side.material, seed, side.albedo, low, x, z);
  const uint32_t along_y = Patch(side.material, seed + 1, side.albedo, low, y, z);
  const uint32_t cap = Patch(top.material, seed + 2, top.albedo, low, x, y);
  Quad(at(0), at(1), at(5), at(4), side.label, along_x);
  Quad(at(1), at(3), at(7), at(5), side.label, along_y);
  Quad(at(3), at(2), at(6), at(7), side.label, along_x);
  Quad(at(2), at(0), at(4), at(6), side.label, along_y);
  Quad(at(4), at(5), at(7), at(6), top.label, cap);
  Quad(at(0), at(2), at(3), at(1), side.label, cap);
  if (!occupies) return;
  Occupy({{low, -x, side.label},
          {high, x, side.label},
          {low, -y, side.label},
          {high, y, side.label},
          {high, z, top.label},
          {low, -z, side.label}},
         {at(0), at(1), at(2), at(3), at(4), at(5), at(6), at(7)});
}

BlockSolids BuildBlock(const CityPlan& plan, int column, int row) {
  BlockSolids block;
  const BlockPlan layout = PlanBlock(plan, column, row);
  for (const BuildingSpec& building : layout.buildings) BuildBuilding(building, block);
  for (const TreeSpec& tree : layout.trees) BuildTree(tree, block);
  block.trees = layout.trees;
  return block;
}

}  // namespace tessera
