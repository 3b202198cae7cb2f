#include "worker/tile/measure_tile.h"

#include <algorithm>
#include <bit>
#include <span>

#include "common/base/elapsed.h"
#include "common/base/parallel.h"
#include "worker/city/pick.h"
#include "worker/visibility/rasterizer.h"
#include "worker/visibility/visible_cells.h"

namespace tessera {
namespace {

constexpr double kMapBytes = 10;    // per pixel: face map, luminance
constexpr int kSharesOfThread = 4;  // of the faces that views add likelihoods to
constexpr int64_t kVertexGrain = 1 << 14;
constexpr int kBandRows = 64;  // that are read at once, in the width of the crop

// The values: a copy in `buffer`, which takes less time than mapping their pages, or the mapped ones.
template <class T>
std::span<const T> Read(const StoredTexels& level, std::span<const T> values, std::vector<T>* buffer) {
  buffer->resize(values.size());
  if (level.copy && level.copy(values.data(), values.size_bytes(), buffer->data())) return *buffer;
  return values;
}

// Sets FaceMap::face to -1 where the photograph has no luminance.
void KeepLit(const StoredTexels& level, FaceMap* map) {
  const PixelRect& rect = level.rect;
  const auto width = static_cast<size_t>(rect.width());
  std::vector<uint16_t> buffer;
  std::span<const uint16_t> band;
  int band_begin = 0, band_end = 0;  // rows of the image
  for (int y = 0; y < map->height; ++y) {
    const int v = map->y0 + y;
    const bool has_row = v >= rect.y0 && v < rect.y1;
    if (has_row && (v < band_begin || v >= band_end)) {
      band_begin = v;
      band_end = std::min({v + kBandRows, rect.y1, map->y0 + map->height});
      band = Read(level, level.luminance.subspan((v - rect.y0) * width, (band_end - v) * width), &buffer);
    }
    for (int x = 0; x < map->width; ++x) {
      const int u = map->x0 + x;
      const bool lit = has_row && u >= rect.x0 && u < rect.x1 && band[(v - band_begin) * width + (u - rect.x0)] != 0;
      if (!lit) map->face[static_cast<size_t>(y) * map->width + x] = -1;
    }
  }
}

// The part of a level's likelihoods that AddLikelihoods samples for a window.
struct LikelihoodWindow {
  LikelihoodSteps steps;
  PixelMapping mapping;
  std::vector<uint8_t> buffer;  // of `steps`

  void Load(const StoredTexels& level, const PixelRect& window) {
    mapping = level.mapping;
    steps = {level.likelihood_width, level.likelihood_height, level.likelihoods, Texels::kLikelihoodSteps};
    // Likelihoods finer than the photograph would exceed the bound of the batch.
    if (level.likelihood_values() > level.pixels() * static_cast<size_t>(level.classes)) return;
    const int rows = level.likelihood_height;
    const PixelRect part = SampledPart(window, level.mapping, level.likelihood_width, rows);
    mapping.first_x += part.x0;
    mapping.first_y += part.y0;
    buffer.resize(static_cast<size_t>(level.classes) * part.width() * part.height());
    steps = {part.width(), part.height(), buffer, Texels::kLikelihoodSteps};
    const auto width = static_cast<size_t>(level.likelihood_width);
    std::vector<uint8_t> whole_rows;
    uint8_t* to = buffer.data();
    for (int c = 0; c < level.classes; ++c) {
      for (int y = part.y0; y < part.y1; y += kBandRows) {
        const auto count = static_cast<size_t>(std::min(kBandRows, part.y1 - y));
        const auto band = level.likelihoods.subspan((static_cast<size_t>(c) * rows + y) * width, count * width);
        const std::span<const uint8_t> read = Read(level, band, &whole_rows);
        for (size_t row = 0; row < count; ++row) to = std::copy_n(&read[row * width + part.x0], part.width(), to);
      }
    }
  }
};

// Draws each view once, several at a time, and adds its likelihoods to the faces that it shows: for each face in the
// order of the views.
StatusOr<FaceLikelihoods> SumLikelihoods(const TileWorkspace& work, const TileImages& images,
                                         const std::vector<Eigen::Vector3d>& positions, const TaskControl& control) {
  const TilePackage& package = work.package();
  const std::vector<RefineView>& views = images.views;
  const ViewGroups& groups = images.groups;
  const TriangleMesh mesh = {positions, package.mesh.faces, {}};
  const CellBoxes boxes(mesh, &package.cells);
  FaceLikelihoods sums(mesh.faces.size(), static_cast<int>(package.classes.size()));
  VisibleCellsProblem problem;
  problem.boxes = boxes.boxes();
  for (const RefineView& view : views) problem.views.push_back(view.window());
  problem.own = OwnCellsOfViews(package.cells, work.measured(), groups.selected, views.size());
  const VisibleCells visible = FindVisibleCells(problem);
  const std::vector<uint8_t> own = work.whole() ? std::vector<uint8_t>() : work.measured();
  std::vector<size_t> seen;
  double largest_bytes = 0;  // of a view's map and likelihoods
  for (size_t v = 0; v < views.size(); ++v) {
    const PixelRect& window = visible.windows[v];
    if (window.empty() || !views[v].pixels->has_likelihoods()) continue;
    seen.push_back(v);
    largest_bytes = std::max(largest_bytes, (kMapBytes + sums.classes) * window.width() * window.height());
  }
  Rasterizer rasterizer;
  const size_t at_once = std::min(static_cast<size_t>(ItemsAtOnce(largest_bytes)), rasterizer.MostAtOnce(mesh));
  std::vector<FaceMap> maps(std::min(at_once, seen.size()));
  std::vector<LikelihoodWindow> likelihoods(maps.size());
  std::vector<FaceShares> shares(maps.size());
  const int share_count =
      std::min<int>(std::bit_ceil(kSharesOfThread * static_cast<unsigned>(ThreadCount())), FaceShares::kMost);
  for (size_t first = 0; first < seen.size(); first += at_once) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(static_cast<double>(first) / static_cast<double>(seen.size()), "collecting likelihoods");
    const std::span<const size_t> batch = std::span(seen).subspan(first, std::min(at_once, seen.size() - first));
    const int threads_each = ThreadCount() / static_cast<int>(batch.size());
    std::vector<Status> read(batch.size());
    ParallelForEach(batch.size(), 1, [&](size_t i) {
      const size_t v = batch[i];
      const StatusOr<StoredTexels> level = views[v].pixels->Level(0);
      read[i] = level.status();
      if (!level.ok()) return;
      const std::vector<uint8_t> selected = groups.SelectedIn(v);
      rasterizer.DrawPart(mesh, boxes.PartOf(visible.cells[v]), {views[v].camera, visible.windows[v]}, &maps[i],
                          kNearPlane_m, SelectionOf(groups, selected), threads_each);
      if (package.views[views[v].index].masked) KeepLit(*level, &maps[i]);
      likelihoods[i].Load(*level, visible.windows[v]);
      shares[i] = FaceShares(maps[i], own, share_count);
    });
    for (const Status& status : read) TESSERA_RETURN_IF_ERROR(status);
    ParallelForEach(share_count, 1, [&](int share) {
      for (size_t i = 0; i < batch.size(); ++i) {
        AddLikelihoods(maps[i], likelihoods[i].steps, likelihoods[i].mapping, own, &sums, shares[i], share);
      }
    });
  }
  return sums;
}

void AddContours(const TileWorkspace& work, const ContourSums& contours, ContourSums* core) {
  std::vector<uint32_t> index(work.package().face_ids.size(), 0);
  for (uint32_t i = 0; i < work.core_faces().size(); ++i) index[work.core_faces()[i]] = i;
  for (const FaceContour& contour : contours.faces) {
    if (!(work.package().regions[contour.face] & kCoreRegion)) continue;  // contours of the sample are not compared
    core->Append(index[contour.face], contour, contours.views);
  }
}

}  // namespace

Status Measure(TileWorkspace& work, TileImages& images, const TileSnapshot& snapshot, const TileStep& at,
               const TileRefineOptions& options, const TaskControl& control, const Clock& clock, StepSums* sums) {
  const int64_t start_us = clock.MonotonicUs();
  sums->energy = sums->semantic_energy = -1;
  sums->warped_pixels = 0;
  sums->seconds_loading = 0;
  if (at.labels()) {
    TESSERA_ASSIGN_OR_RETURN(sums->likelihoods, SumLikelihoods(work, images, snapshot.positions, control));
    return absl::OkStatus();
  }
  const TilePackage& package = work.package();
  if (!package.has_pairs) return absl::OkStatus();
  TESSERA_RETURN_IF_ERROR(images.data_term.EnterLevel(at.step.level));
  sums->seconds_loading = SecondsSince(clock, start_us);
  TriangleMesh& mesh = images.surface;
  if (mesh.faces.empty()) mesh.faces = package.mesh.faces;
  mesh.vertices.resize(snapshot.positions.size());
  ParallelForEach(mesh.vertices.size(), kVertexGrain, [&](size_t v) { mesh.vertices[v] = snapshot.positions[v]; });
  mesh.labels.clear();
  if (GeometryUsesLabels(package, options)) mesh.labels = snapshot.labels;
  images.data_term.Evaluate(mesh, work.whole() ? std::vector<uint8_t>() : work.measured(), at.step.directions, &clock,
                            &sums->derivatives);
  const PhotoSums& photo = sums->derivatives.photo;
  if (photo.sums.weight > 0) sums->energy = photo.sums.energy / photo.sums.weight;
  if (photo.sums.semantic_pixels > 0) {
    sums->semantic_energy = photo.sums.semantic_energy / static_cast<double>(photo.sums.semantic_pixels);
  }
  sums->warped_pixels = photo.warped_pixels;
  return absl::OkStatus();
}

TileSums CoreSums(const TileWorkspace& work, const StepSums& sums) {
  const TilePackage& package = work.package();
  TileSums out;
  out.tile = package.tile;
  out.energy = sums.energy;
  out.semantic_energy = sums.semantic_energy;
  out.warped_pixels = sums.warped_pixels;
  out.fit = sums.fit;
  const std::vector<FaceSums>& photo = sums.derivatives.photo.faces;
  const FaceLikelihoods& likelihoods = sums.likelihoods;
  const auto fill = [&](const std::vector<uint32_t>& faces, FaceSumsById* to) {
    to->face_ids = Pick(package.face_ids, faces);
    to->photo = Pick(photo, faces);
    to->pixels = Pick(likelihoods.pixels, faces);
    for (const uint32_t f : faces) {
      const auto of_face = likelihoods.sum.begin() + static_cast<ptrdiff_t>(f) * likelihoods.classes;
      to->likelihoods.insert(to->likelihoods.end(), of_face, of_face + likelihoods.classes);
    }
  };
  fill(work.core_faces(), &out);
  fill(work.sample_faces(), &out.sample);
  if (!photo.empty()) AddContours(work, sums.derivatives.contours, &out.contours);
  if (!likelihoods.pixels.empty()) out.classes = likelihoods.classes;
  return out;
}

}  // namespace tessera
