#include "common/synth/start_mesh/start_mesh.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <unordered_map>

#include "common/base/random.h"
#include "common/synth/labels/label_noise.h"
#include "common/synth/noise.h"
#include "common/synth/start_mesh/marching_cubes.h"

namespace tessera {
namespace {

// The cells of the global lattice that belong to a block along one axis; outermost blocks include the apron.
struct CellRange {
  int begin, end;
};

CellRange CellsOf(double low, int blocks, int block, double voxel) {
  const auto cell = [&](double x) { return static_cast<int>(std::floor(x / voxel + 0.5)); };
  const double from = low + block * CityPlan::kPitch, to = from + CityPlan::kPitch;
  return {cell(block == 0 ? from - CityPlan::kApron : from), cell(block + 1 == blocks ? to + CityPlan::kApron : to)};
}

// The city's occupancy: negative inside, in metres near the surface.
class OccupancyField {
 public:
  OccupancyField(const CityPlan& plan, const BlockSource& source, int column, int row, double voxel)
      : plan_(plan), voxel_(voxel) {
    const Eigen::Vector2d origin = plan.BlockOrigin(column, row);
    const double margin = 3 * voxel;
    for (int r = std::max(0, row - 1); r <= std::min(plan.rows - 1, row + 1); ++r) {
      for (int c = std::max(0, column - 1); c <= std::min(plan.columns - 1, column + 1); ++c) {
        const BlockSolids& block = source.Solids(c, r);
        const auto near = [&](const Eigen::AlignedBox3d& box) {
          return box.max().x() > origin.x() - margin && box.min().x() < origin.x() + CityPlan::kPitch + margin &&
                 box.max().y() > origin.y() - margin && box.min().y() < origin.y() + CityPlan::kPitch + margin;
        };
        for (const ConvexSolid& solid : block.solids) {
          if (near(solid.box)) solids_.push_back(&solid);
        }
        for (const TreeSpec& tree : block.trees) {
          const Eigen::Vector3d reach = 1.4 * tree.radii_m;
          Eigen::AlignedBox3d box(tree.foot - reach, tree.foot + reach + Eigen::Vector3d(0, 0, tree.crown_z_m));
          if (near(box)) trees_.push_back({&tree, box});
        }
      }
    }
  }

  // The objects near the vertical line through (x, y).
  struct Column {
    double ground = 0, top = 0;
    int32_t ground_label = kGround;
    std::vector<const ConvexSolid*> solids;
    std::vector<const TreeSpec*> trees;
  };
  Column At(double x, double y, double margin) const {
    Column column;
    column.ground = column.top = GroundHeight(plan_, x, y);
    if (PlantingAt(plan_, x, y) != nullptr) column.ground_label = kVegetation;
    const auto covers = [&](const Eigen::AlignedBox3d& box) {
      return x > box.min().x() - margin && x < box.max().x() + margin && y > box.min().y() - margin &&
             y < box.max().y() + margin;
    };
    for (const ConvexSolid* solid : solids_) {
      if (!covers(solid->box)) continue;
      column.solids.push_back(solid);
      column.top = std::max(column.top, solid->box.max().z());
    }
    for (const auto& [tree, box] : trees_) {
      if (!covers(box)) continue;
      column.trees.push_back(tree);
      column.top = std::max(column.top, box.max().z());
    }
    return column;
  }

  // Signed distance to the nearest object. Trees are enlarged, as reconstruction fills the gaps of their crowns.
  double Distance(const Column& column, const Eigen::Vector3d& p) const {
    double best = p.z() - column.ground;
    for (const ConvexSolid* solid : column.solids) best = std::min(best, solid->Distance(p));
    for (const TreeSpec* tree : column.trees) best = std::min(best, CrownDistance(*tree, p) - 0.25 * voxel_);
    return best;
  }

  // Class of the true surface nearest to `p`. `turn_m` > 0 adds a penalty of up to 2 turn_m to the distance of surfaces
  // whose normal differs from `normal`.
  int32_t NearestLabel(const Column& column, const Eigen::Vector3d& p, const Eigen::Vector3d& normal,
                       double turn_m) const {
    const double nearest = Distance(column, p);
    double least = p.z() - column.ground - nearest + turn_m * (1 - normal.z());
    int32_t label = column.ground_label;
    const auto offer = [&](double cost, int32_t candidate) {
      if (cost < least) {
        least = cost;
        label = candidate;
      }
    };
    for (const ConvexSolid* solid : column.solids) {
      const double d = solid->Distance(p);
      for (const ConvexSolid::Plane& plane : solid->planes) {
        const double beyond = d - (plane.normal.dot(p) - plane.offset);
        offer(d - nearest + beyond + turn_m * (1 - normal.dot(plane.normal)), plane.label);
      }
    }
    for (const TreeSpec* tree : column.trees)
      offer(CrownDistance(*tree, p) - 0.25 * voxel_ - nearest + 0.4 * turn_m, kVegetation);
    return label;
  }

  // Displacement of the surface by noise in metres: bumps of a few voxels, and broader waves.
  double Displacement(const Eigen::Vector3d& p) const {
    const uint32_t seed = static_cast<uint32_t>(MixBits(plan_.seed ^ 0x766f78656cull));
    const Eigen::Vector3d q = p / voxel_;
    return voxel_ * (0.45 * ValueNoise3(q.x() / 1.7, q.y() / 1.7, q.z() / 1.7, seed) +
                     0.3 * ValueNoise3(q.x() / 5.0, q.y() / 5.0, q.z() / 5.0, seed + 1));
  }

 private:
  const CityPlan& plan_;
  double voxel_;
  std::vector<const ConvexSolid*> solids_;
  std::vector<std::pair<const TreeSpec*, Eigen::AlignedBox3d>> trees_;
};

// Values on the lattice points [x0, x0 + nx) x [y0, y0 + ny) x [z0, z0 + nz).
struct Lattice {
  int x0, y0, z0, nx, ny, nz;
  std::vector<float> value;
  float& at(int x, int y, int z) { return value[(static_cast<size_t>(y - y0) * nx + (x - x0)) * nz + (z - z0)]; }
  float at(int x, int y, int z) const { return value[(static_cast<size_t>(y - y0) * nx + (x - x0)) * nz + (z - z0)]; }
};

// Blurs with the weights 1 2 1 along each axis, like the smoothing of volumetric methods.
void Blur(Lattice& lattice) {
  const size_t strides[3] = {static_cast<size_t>(lattice.nz), static_cast<size_t>(lattice.nz) * lattice.nx, 1};
  const int counts[3] = {lattice.nx, lattice.ny, lattice.nz};
  for (int axis = 0; axis < 3; ++axis) {
    const std::vector<float> source = lattice.value;
    for (size_t k = 0; k < source.size(); ++k) {
      const int index = static_cast<int>(k / strides[axis] % counts[axis]);
      const float before = index > 0 ? source[k - strides[axis]] : source[k];
      const float after = index + 1 < counts[axis] ? source[k + strides[axis]] : source[k];
      lattice.value[k] = 0.25f * before + 0.5f * source[k] + 0.25f * after;
    }
  }
}

uint64_t EdgeKey(int x, int y, int z, int axis) {
  const auto part = [](int v) { return static_cast<uint64_t>(v + (1 << 19)) & 0xfffff; };
  return part(x) | part(y) << 20 | part(z) << 40 | static_cast<uint64_t>(axis) << 60;
}

}  // namespace

// Every value is a function of the global lattice position, not of the block, so that adjacent chunks compute identical
// vertices on their border. The lattice has one more layer than the cells, because the blur reads the neighbours.
StartChunk ExtractStartChunk(const CityPlan& plan, const BlockSource& source, int column, int row) {
  const double voxel = kVoxelPerGsd * plan.gsd_m;
  const CellRange xs = CellsOf(plan.MinX(), plan.columns, column, voxel),
                  ys = CellsOf(plan.MinY(), plan.rows, row, voxel);
  const OccupancyField field(plan, source, column, row, voxel);
  // Lattice points of the cells and one more layer around them for the blur.
  Lattice lattice{xs.begin - 1, ys.begin - 1, 0, xs.end - xs.begin + 3, ys.end - ys.begin + 3, 0, {}};
  std::vector<OccupancyField::Column> columns(static_cast<size_t>(lattice.nx) * lattice.ny);
  double low = 1e9, high = -1e9;
  for (int y = 0; y < lattice.ny; ++y) {
    for (int x = 0; x < lattice.nx; ++x) {
      auto& c = columns[static_cast<size_t>(y) * lattice.nx + x];
      c = field.At((lattice.x0 + x) * voxel, (lattice.y0 + y) * voxel, 1.5 * voxel);
      low = std::min(low, c.ground);
      high = std::max(high, c.top);
    }
  }
  lattice.z0 = static_cast<int>(std::floor(low / voxel)) - 4;
  lattice.nz = static_cast<int>(std::ceil(high / voxel)) + 4 - lattice.z0;
  lattice.value.resize(columns.size() * lattice.nz);
  for (int y = 0; y < lattice.ny; ++y) {
    for (int x = 0; x < lattice.nx; ++x) {
      const auto& c = columns[static_cast<size_t>(y) * lattice.nx + x];
      for (int z = 0; z < lattice.nz; ++z) {
        const Eigen::Vector3d p((lattice.x0 + x) * voxel, (lattice.y0 + y) * voxel, (lattice.z0 + z) * voxel);
        double d = field.Distance(c, p);
        if (std::abs(d) < 1.4 * voxel) d += field.Displacement(p);
        lattice.at(lattice.x0 + x, lattice.y0 + y, lattice.z0 + z) = d < 0 ? 1.f : 0.f;
      }
    }
  }
  Blur(lattice);

  StartChunk chunk;
  std::unordered_map<uint64_t, uint32_t> vertex_of_key;
  const auto& edges = CubeEdgeTable();
  const auto& table = CubeLoopTable();
  const uint32_t doubt_seed = static_cast<uint32_t>(MixBits(plan.seed ^ 0x646f756274ull));
  for (int y = ys.begin; y < ys.end; ++y) {
    for (int x = xs.begin; x < xs.end; ++x) {
      for (int z = lattice.z0; z + 1 < lattice.z0 + lattice.nz; ++z) {
        int inside = 0;
        for (int c = 0; c < 8; ++c) inside |= (lattice.at(x + (c & 1), y + (c >> 1 & 1), z + (c >> 2)) >= 0.5f) << c;
        if (inside == 0 || inside == 255) continue;
        for (const CubeLoop& loop : table[inside]) {
          std::array<uint32_t, kCubeEdges> loop_vertices;
          for (size_t k = 0; k < loop.edges.size(); ++k) {
            const CubeEdge& edge = edges[loop.edges[k]];
            const int ex = x + (edge.corner & 1), ey = y + (edge.corner >> 1 & 1), ez = z + (edge.corner >> 2);
            const uint64_t key = EdgeKey(ex, ey, ez, edge.axis);
            const auto [index, fresh] = vertex_of_key.try_emplace(key, static_cast<uint32_t>(chunk.vertices.size()));
            if (fresh) {
              const Eigen::Vector3i step(edge.axis == 0, edge.axis == 1, edge.axis == 2);
              const float a = lattice.at(ex, ey, ez), b = lattice.at(ex + step.x(), ey + step.y(), ez + step.z());
              const double t = std::clamp<double>((a - 0.5f) / (a - b), 0.08, 0.92);
              chunk.vertices.push_back(voxel * (Eigen::Vector3d(ex, ey, ez) + t * step.cast<double>()));
              chunk.keys.push_back(key);
              chunk.on_border.push_back(ex == xs.begin || ex == xs.end || ey == ys.begin || ey == ys.end);
            }
            loop_vertices[k] = index->second;
          }
          const size_t n = loop.edges.size();
          if (loop.needs_centre) {
            Eigen::Vector3d centre = Eigen::Vector3d::Zero();
            for (size_t k = 0; k < n; ++k) centre += chunk.vertices[loop_vertices[k]] / static_cast<double>(n);
            const uint32_t middle = static_cast<uint32_t>(chunk.vertices.size());
            chunk.vertices.push_back(centre);
            chunk.keys.push_back(StartChunk::kNoKey);
            chunk.on_border.push_back(false);
            for (size_t k = 0; k < n; ++k)
              chunk.faces.push_back({middle, loop_vertices[k], loop_vertices[(k + 1) % n]});
          } else {
            for (size_t k = 1; k + 1 < n; ++k)
              chunk.faces.push_back({loop_vertices[0], loop_vertices[k], loop_vertices[k + 1]});
          }
        }
      }
    }
  }
  for (const Triangle& t : chunk.faces) {
    const Eigen::Vector3d p = (chunk.vertices[t[0]] + chunk.vertices[t[1]] + chunk.vertices[t[2]]) / 3;
    const OccupancyField::Column c = field.At(p.x(), p.y(), 2 * voxel);
    const Eigen::Vector3d normal = (chunk.vertices[t[1]] - chunk.vertices[t[0]])
                                       .cross(chunk.vertices[t[2]] - chunk.vertices[t[0]])
                                       .stableNormalized();
    const int32_t label = field.NearestLabel(c, p, normal, 1.2 * voxel);
    chunk.true_labels.push_back(static_cast<uint8_t>(field.NearestLabel(c, p, normal, 0)));
    chunk.right_labels.push_back(static_cast<uint8_t>(label));
    const LabelDoubt doubt = SurfaceDoubt(p, voxel, doubt_seed);
    chunk.doubt.push_back(doubt.doubt);
    chunk.wrong_labels.push_back(static_cast<uint8_t>(ConfusedClass(label, doubt.choice)));
  }
  return chunk;
}

}  // namespace tessera
