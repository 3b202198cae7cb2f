#include "worker/tile/cut_tile.h"

#include <algorithm>
#include <array>
#include <map>
#include <optional>
#include <set>
#include <span>

#include "absl/strings/str_cat.h"
#include "common/job/sample_cell.h"
#include "worker/city/collected_faces.h"
#include "worker/refine/descent.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

using CellAt = std::array<int32_t, 2>;

// Order by y, then x, as cells in surveys and packages.
struct CellOrder {
  bool operator()(const CellAt& a, const CellAt& b) const { return a[1] != b[1] ? a[1] < b[1] : a[0] < b[0]; }
};
using CellSet = std::set<CellAt, CellOrder>;

// The cells of the faces for which wanted(face) is true. Consecutive faces are mostly in the same cell.
template <class Wanted>
CellSet CellsOfFaces(const std::vector<CellAt>& cell, const Wanted& wanted) {
  CellSet cells;
  const CellAt* last = nullptr;
  for (size_t f = 0; f < cell.size(); ++f) {
    if (!wanted(f) || (last != nullptr && *last == cell[f])) continue;
    cells.insert(cell[f]);
    last = &cell[f];
  }
  return cells;
}

// The ground cell that contains a package cell.
CellAt GroundCellOf(const CellAt& at) {
  const auto down = [](int32_t i) { return i >= 0 ? i / kPackageCellsAcross : -((-i - 1) / kPackageCellsAcross) - 1; };
  return {down(at[0]), down(at[1])};
}

CellAt CellOf(const GroundPlane& ground, const Eigen::Vector3d& p) {
  const Eigen::Vector2i at = ground.Cell(p);
  return {at.x(), at.y()};
}

// Some blocks of the city as one mesh.
struct LoadedBlocks {
  CollectedFaces faces;
  std::vector<Eigen::Vector3d> positions;  // of the vertices, where contacts are looked for
  std::vector<CellAt> cell;                // per face
  std::vector<Cell> label_cell;            // per face
  CsrRows faces_of_vertex;
};

// `moved`: as CutTile.
StatusOr<LoadedBlocks> Load(const CityReader& city, const Survey& survey, const MovedSpans* moved,
                            const std::vector<uint8_t>& blocks) {
  FaceCollector found;
  for (size_t b = 0; b < blocks.size(); ++b) {
    if (!blocks[b]) continue;
    TESSERA_ASSIGN_OR_RETURN(const CityBlock block, city.Block(b));
    for (size_t f = 0; f < block.face_ids.size(); ++f) found.Add(block, f);
  }
  LoadedBlocks loaded;
  loaded.faces = found.Finish();
  const TriangleMesh& mesh = loaded.faces.mesh;
  loaded.positions = mesh.vertices;
  for (size_t v = 0; v < loaded.positions.size() && moved != nullptr; ++v) {
    const uint32_t id = loaded.faces.vertex_ids[v];
    if (id >= moved->positions.size()) {
      return absl::DataLossError(
          absl::StrCat("found vertex ", id, " in the city, and positions of ", moved->positions.size(), " vertices"));
    }
    loaded.positions[v] = moved->positions[id];
  }
  loaded.cell.resize(mesh.faces.size());
  loaded.label_cell.resize(mesh.faces.size());
  for (size_t f = 0; f < loaded.cell.size(); ++f) {
    const Eigen::Vector3d centroid = MeshSpans(mesh).Centroid(f);
    loaded.cell[f] = CellOf(survey.ground, centroid);
    loaded.label_cell[f] = LabelCellOf(survey.ground, survey.gsd_m, centroid);
  }
  loaded.faces_of_vertex = FacesOfVertices(mesh);
  return loaded;
}

// Marks the blocks that may contain data about the faces with a bit in `regions`: one of their vertices, or a face
// that may touch them. `near_m`: distance between a face of LoadedBlocks::positions and the block of another that it
// may touch. Returns whether there are any.
bool AddBlocksAbout(const CityReader& city, const LoadedBlocks& loaded, const std::vector<uint8_t>& regions,
                    double near_m, std::vector<uint8_t>* blocks) {
  const TriangleMesh& mesh = loaded.faces.mesh;
  std::vector<uint8_t> used(mesh.vertices.size(), 0);  // per vertex: regions that use it
  for (size_t f = 0; f < regions.size(); ++f) {
    for (const uint32_t v : mesh.faces[f]) used[v] |= regions[f];
  }
  const Eigen::Vector3d margin = Eigen::Vector3d::Constant(near_m);
  bool any = false;
  for (size_t b = 0; b < blocks->size(); ++b) {
    if ((*blocks)[b]) continue;
    const Eigen::AlignedBox3d& box = city.box(b);
    const Eigen::AlignedBox3d wide(box.min() - margin, box.max() + margin);
    for (size_t v = 0; v < used.size() && !(*blocks)[b]; ++v) {
      if (used[v] == 0) continue;
      if (box.contains(mesh.vertices[v]) || ((used[v] & kRepairRegion) && wide.contains(loaded.positions[v]))) {
        (*blocks)[b] = 1;
        any = true;
      }
    }
    // A face may cross a block without having a vertex in it.
    for (size_t f = 0; f < regions.size() && !(*blocks)[b]; ++f) {
      if (!(regions[f] & kRepairRegion)) continue;
      Eigen::AlignedBox3d face;
      for (const uint32_t v : mesh.faces[f]) face.extend(loaded.positions[v]);
      if (face.intersects(wide)) {
        (*blocks)[b] = 1;
        any = true;
      }
    }
  }
  return any;
}

// Returns whether any was not marked before.
bool AddBlocksOf(const CityReader& city, const CellSet& cells, std::vector<uint8_t>* blocks) {
  bool any = false;
  for (size_t b = 0; b < blocks->size(); ++b) {
    if ((*blocks)[b]) continue;
    const CellRect& rect = city.cells(b);
    (*blocks)[b] = std::any_of(cells.begin(), cells.end(), [&](const CellAt& at) {
      return rect.Contains({at[0], at[1]});
    });
    any = any || (*blocks)[b] != 0;
  }
  return any;
}

// Range of depths that the job matches in a view, including the motion of the surface.
std::array<double, 2> DepthsOfView(const Survey& survey, int32_t view, double motion_m) {
  const auto& [near_m, far_m] = survey.view_depths[view];
  return {std::max(near_m - motion_m, kNearPlane_m), std::max(far_m + motion_m, 2 * kNearPlane_m)};
}

// The faces of `cells` in the package's order.
void FillMesh(const LoadedBlocks& loaded, const std::vector<uint8_t>& regions, const CellSet& cells,
              const GroundPlane& ground, TilePackage* package) {
  const TriangleMesh& mesh = loaded.faces.mesh;
  const GroundPlane small = PackageCells(ground);
  std::vector<uint32_t> faces, vertices;
  std::vector<uint8_t> used(mesh.vertices.size(), 0);
  std::vector<CellAt> face_cell(mesh.faces.size()), vertex_cell(mesh.vertices.size());
  bool wanted = false;
  for (uint32_t f = 0; f < mesh.faces.size(); ++f) {
    if (f == 0 || loaded.cell[f] != loaded.cell[f - 1]) wanted = cells.contains(loaded.cell[f]);
    if (!wanted) continue;
    faces.push_back(f);
    face_cell[f] = CellOf(small, MeshSpans(mesh).Centroid(f));
    for (const uint32_t v : mesh.faces[f]) used[v] = 1;
  }
  for (uint32_t v = 0; v < used.size(); ++v) {
    if (!used[v]) continue;
    vertices.push_back(v);
    vertex_cell[v] = CellOf(small, mesh.vertices[v]);
  }
  // Ids already ascend.
  const CellOrder before;
  std::vector<CellAt> all;
  const auto sort = [&](const std::vector<CellAt>& cell, std::vector<uint32_t>* items) {
    std::stable_sort(items->begin(), items->end(), [&](uint32_t a, uint32_t b) { return before(cell[a], cell[b]); });
    for (const uint32_t item : *items) {
      if (all.empty() || all.back() != cell[item]) all.push_back(cell[item]);
    }
  };
  sort(face_cell, &faces);
  sort(vertex_cell, &vertices);
  std::sort(all.begin(), all.end(), before);
  all.erase(std::unique(all.begin(), all.end()), all.end());
  package->cell_at = std::move(all);
  const auto begins = [&](const std::vector<uint32_t>& items, const std::vector<CellAt>& cell) {
    std::vector<uint32_t> begin;
    uint32_t at = 0;
    for (const CellAt& c : package->cell_at) {
      begin.push_back(at);
      while (at < items.size() && cell[items[at]] == c) ++at;
    }
    begin.push_back(at);
    return begin;
  };
  package->cells.face_begin = begins(faces, face_cell);
  package->cells.vertex_begin = begins(vertices, vertex_cell);

  std::vector<uint32_t> local(mesh.vertices.size());
  for (const uint32_t v : vertices) {
    local[v] = static_cast<uint32_t>(package->vertex_ids.size());
    package->vertex_ids.push_back(loaded.faces.vertex_ids[v]);
    package->mesh.vertices.push_back(mesh.vertices[v]);
    uint8_t some = 0, every = 0xff;
    for (const uint32_t f : loaded.faces_of_vertex[v]) {
      some |= regions[f];
      every &= regions[f];
    }
    package->cut_regions.push_back(some & static_cast<uint8_t>(~every));
  }
  for (const uint32_t f : faces) {
    const Triangle& face = mesh.faces[f];
    package->face_ids.push_back(loaded.faces.face_ids[f]);
    package->mesh.faces.push_back({local[face[0]], local[face[1]], local[face[2]]});
    package->mesh.labels.push_back(mesh.labels[f]);
    package->regions.push_back(regions[f]);
  }
  FindVertexCells(package->mesh.faces, &package->cells);
}

// Flags the faces of a ground cell that are in its first non-empty package cell.
void FlagSample(const LoadedBlocks& loaded, const GroundPlane& ground, const CellAt& sample,
                std::vector<uint8_t>* regions) {
  const GroundPlane small = PackageCells(ground);
  const auto small_cell = [&](size_t f) { return CellOf(small, MeshSpans(loaded.faces.mesh).Centroid(f)); };
  std::optional<CellAt> first;
  const CellOrder before;
  for (size_t f = 0; f < regions->size(); ++f) {
    if (loaded.cell[f] != sample) continue;
    const CellAt at = small_cell(f);
    if (!first || before(at, *first)) first = at;
  }
  for (size_t f = 0; first && f < regions->size(); ++f) {
    if (loaded.cell[f] == sample && small_cell(f) == *first) (*regions)[f] |= kSampleRegion;
  }
}

}  // namespace

CutOptions CutOptionsOf(const CutParameters& p, double gsd_m, const TileRefineOptions& options) {
  CutOptions out;
  StepperOptions stepper = options.step;
  stepper.max_step_px = p.max_step_px.value_or(stepper.max_step_px);
  const MotionLimits limits = MakeMotionLimits(stepper, gsd_m);
  out.motion_m = out.visible_set.motion_m = MotionBound_m(limits);
  if (!p.fine_iterations.empty()) {
    double path_m = 0;
    for (const int iterations : p.fine_iterations) {
      for (int i = 0; i < iterations; ++i) path_m += LongestStep_m(stepper, gsd_m, p.coarsest_level, i);
    }
    out.visible_set.motion_m = std::min(path_m, 2 * out.motion_m);
  }
  out.visible_set.reference_margin_px = ReferenceMargin_px(p.window_px, p.coarsest_level);
  out.visible_set.target_margin_px = TargetMargin_px(p.coarsest_level);
  out.visible_set.alignment_px = 1 << p.coarsest_level;
  out.radius.solve_rings = StepDependencyRadiusOf(stepper.smoothing_sweeps, limits).rings();
  out.radius.repair = RepairDependencyRadiusOf(stepper);
  out.radius.contact_m = 2 * out.visible_set.motion_m;
  out.radius.label = LabelDependencyRadiusOf(options.solver);
  return out;
}

StatusOr<CutResult> CutTile(const CityReader& city, const Survey& survey, const CutParameters& p,
                            const CutOptions& options, const MovedSpans* moved) {
  const GroundPlane& ground = survey.ground;
  const SurveyCell* sample = nullptr;
  for (const SurveyCell& cell : survey.cells) sample = BetterSampleCell(sample, cell, p.tile.core);
  std::vector<uint8_t> measured_cells(survey.cells.size());  // cells of the core and of the sample
  std::set<int32_t> chosen;
  for (size_t c = 0; c < measured_cells.size(); ++c) {
    const SurveyCell& cell = survey.cells[c];
    measured_cells[c] = p.tile.core.Contains({cell.x, cell.y}) || &cell == sample;
    if (measured_cells[c]) chosen.insert(cell.views.begin(), cell.views.end());
  }
  // And their partners: at the border of a cell that did not select a view, a pixel may be warped onto a cell that
  // did.
  const std::set<int32_t> of_core = chosen;
  for (const auto& [reference, other] : survey.pairs) {
    if (of_core.contains(reference)) chosen.insert(other);
  }
  std::vector<int32_t> views(chosen.begin(), chosen.end());
  if (!views.empty() && (views.front() < 0 || views.back() >= static_cast<int32_t>(survey.views.size()))) {
    return absl::InvalidArgumentError(
        absl::StrCat("tile ", p.tile.tile, ": found view ", views.back(), " of ", survey.views.size()));
  }
  if (survey.view_depths.size() != survey.views.size()) {
    return absl::InvalidArgumentError(absl::StrCat("tile ", p.tile.tile, ": found depths of ",
                                                   survey.view_depths.size(), " views of ", survey.views.size()));
  }
  VisibleSet visible = FindVisibleSet(survey, measured_cells, views, options.visible_set,
                                      moved == nullptr ? std::span<const Eigen::AlignedBox3d>() : moved->cell_boxes);
  // Partners without needed pixels are dropped: they do not affect the tile.
  size_t kept = 0;
  for (size_t v = 0; v < views.size(); ++v) {
    if (visible.windows[v].empty()) continue;
    views[kept] = views[v];
    visible.windows[kept++] = visible.windows[v];
  }
  views.resize(kept);
  visible.windows.resize(kept);

  CellSet visible_cells;
  for (size_t c = 0; c < visible.cells.size(); ++c) {
    if (visible.cells[c] || measured_cells[c]) visible_cells.insert({survey.cells[c].x, survey.cells[c].y});
  }
  // Blocks know where their faces are at the start.
  const double near_m = options.radius.contact_m + (moved == nullptr ? 0 : options.motion_m);
  // Add blocks until none contains more data about the faces found. The regions need whole neighbourhoods, whose
  // extent is only known once their faces are loaded, hence the loop. Begins with those near the visible cells, which
  // contain most regions, so that mostly one round suffices.
  CellRect sight = p.tile.core;
  for (const CellAt& at : visible_cells) {
    sight = {std::min(sight.x0, at[0]), std::min(sight.y0, at[1]), std::max(sight.x1, at[0] + 1),
             std::max(sight.y1, at[1] + 1)};
  }
  std::vector<uint8_t> blocks(city.block_count());
  for (size_t b = 0; b < blocks.size(); ++b) {
    blocks[b] = DistanceBetween(city.cells(b), sight, ground.cell_m) <= near_m;
  }
  LoadedBlocks loaded;
  std::vector<uint8_t> regions;
  do {
    TESSERA_ASSIGN_OR_RETURN(loaded, Load(city, survey, moved, blocks));
    std::vector<uint8_t> core(loaded.cell.size());
    for (size_t f = 0; f < core.size(); ++f) core[f] = p.tile.core.Contains({loaded.cell[f][0], loaded.cell[f][1]});
    if (std::find(core.begin(), core.end(), 1) == core.end()) {
      return absl::InvalidArgumentError(absl::StrCat("tile ", p.tile.tile, ": found no faces in its core"));
    }
    regions = FindRegions(loaded.faces.mesh, loaded.positions, loaded.faces_of_vertex, loaded.label_cell, core,
                          options.radius);
  } while (AddBlocksAbout(city, loaded, regions, near_m, &blocks));
  const auto cells_of = [&](uint8_t bits) {
    return CellsOfFaces(loaded.cell, [&](size_t f) { return (regions[f] & bits) != 0; });
  };
  CellSet cells = cells_of(0xff);
  std::map<uint8_t, CellSet> of_region;
  for (const uint8_t region : {kSolveRegion, kRepairRegion, kLabelRegion}) of_region[region] = cells_of(region);
  cells.insert(visible_cells.begin(), visible_cells.end());
  if (AddBlocksOf(city, cells, &blocks)) {
    // Both lists of faces ascend, and the second contains the first.
    const std::vector<uint32_t> before_ids = std::move(loaded.faces.face_ids);
    const std::vector<uint8_t> before_regions = std::move(regions);
    TESSERA_ASSIGN_OR_RETURN(loaded, Load(city, survey, moved, blocks));
    regions.assign(loaded.faces.face_ids.size(), 0);
    for (size_t f = 0, b = 0; f < regions.size() && b < before_ids.size(); ++f) {
      if (loaded.faces.face_ids[f] == before_ids[b]) regions[f] = before_regions[b++];
    }
  }
  if (sample != nullptr) FlagSample(loaded, ground, {sample->x, sample->y}, &regions);

  CutResult result;
  TilePackage& package = result.package;
  package.tile = p.tile.tile;
  package.ground = ground;
  package.gsd_m = survey.gsd_m;
  package.up = survey.up;
  package.classes = survey.classes;
  package.has_likelihoods = survey.has_likelihoods;
  package.borders = survey.borders;
  package.has_labels = survey.has_labels;
  package.has_pairs = std::any_of(survey.cells.begin(), survey.cells.end(), [&](const SurveyCell& cell) {
    return std::any_of(survey.pairs.begin(), survey.pairs.end(), [&](const std::array<int32_t, 2>& pair) {
      return std::binary_search(cell.views.begin(), cell.views.end(), pair[0]) &&
             std::binary_search(cell.views.begin(), cell.views.end(), pair[1]);
    });
  });
  package.view_ids = views;
  package.view_rects = visible.windows;
  std::map<int32_t, int32_t> local_view;
  for (const int32_t view : views) {
    local_view.emplace(view, static_cast<int32_t>(package.views.size()));
    package.views.push_back(survey.views[view]);
    package.view_depths.push_back(DepthsOfView(survey, view, options.motion_m));
  }
  for (const auto& [reference, other] : survey.pairs) {
    const auto r = local_view.find(reference), o = local_view.find(other);
    if (r != local_view.end() && o != local_view.end()) package.pairs.push_back({r->second, o->second});
  }
  FillMesh(loaded, regions, cells, ground, &package);
  std::map<CellAt, const SurveyCell*, CellOrder> surveyed;
  for (const SurveyCell& cell : survey.cells) surveyed[{cell.x, cell.y}] = &cell;
  for (const CellAt& at : package.cell_at) {
    std::vector<int32_t>& selected = package.cell_views.emplace_back();
    const auto cell = surveyed.find(GroundCellOf(at));
    if (cell == surveyed.end()) continue;
    for (const int32_t view : cell->second->views) {
      if (const auto local = local_view.find(view); local != local_view.end()) selected.push_back(local->second);
    }
  }
  const auto tiles_of = [&](const CellSet& of) {
    std::vector<int> tiles;
    for (size_t t = 0; t < p.cores.size(); ++t) {
      const bool has = std::any_of(of.begin(), of.end(), [&](const CellAt& c) {
        return p.cores[t].Contains({c[0], c[1]});
      });
      if (has) tiles.push_back(static_cast<int>(t));
    }
    return tiles;
  };
  result.reads.visibility = tiles_of(visible_cells);
  result.reads.solve = tiles_of(of_region[kSolveRegion]);
  result.reads.repair = tiles_of(of_region[kRepairRegion]);
  result.reads.label = tiles_of(of_region[kLabelRegion]);
  return result;
}

}  // namespace tessera
