#include "server/tiling/cost_model.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <string>
#include <utility>

#include "common/job/change_cells.h"
#include "common/job/sample_cell.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

// As in worker/tile/tile_views.cc.
constexpr double kCropMargin_px = 32, kCropAlignment_px = 16;
// Margin of a reference's pixels: two window radii (PhotoTerm).
constexpr double kReferenceMargin_px = 6;
constexpr double kNear_m = 1e-3;

// --- Fitted constants (tests/bench/cost_bench.cc) ---

constexpr double kMiB = 1 << 20;

// An idle worker.
constexpr double kFixedBytes = 40 * kMiB;
// Pixels of the windows in memory at once / pixels of these crops; in measure with the windows of references. Bytes per
// pixel of all crops at full resolution: contours lie along edges, so they grow with the width of the images.
constexpr double kRefineWindows = 0.65, kMeasureWindows = 1.3, kContourBytes = 5.5;
// Face map, warp target and luminance of a pixel; PixelBytes adds likelihoods. Face map and luminance of a label step.
constexpr double kOpenPixelBytes = 14, kLabelPixelBytes = 10;
// Predictions are for two threads: what more of them need is bounded by a small share of a worker's memory
// (LookaheadLimit_bytes). Views that two threads open ahead (ViewSchedule), and the bound on their memory.
constexpr double kViewsAhead = 4, kAheadBytes = 256 * kMiB;
// Bytes per face: of refine; of measure in the core and of solve in its region, and of these tasks in the package, more
// in a label step; of mend in the package.
constexpr double kRefineBytesPerFace = 690;
constexpr double kMeasureBytesPerFace = 300, kMeasurePackageBytes = 60, kLabelPackageBytes = 110;
constexpr double kSolveBytesPerFace = 330, kSolvePackageBytes = 190, kMendBytesPerFace = 350;
// Crop. Bytes per pixel of the whole file: photograph (RGB and compressed); .npy array, per class; .png labels. TIFFs
// are not held whole. kCropBytes: per pixel and plane of the crop (floats before and after undistortion, and as
// stored).
constexpr double kLoadBytesPerFace = 200, kImageBytes = 4, kArrayBytes = 4, kLabelBytes = 2, kCropBytes = 8;
constexpr double kTaskSeconds = 0.01;      // per task: transfer of its files
constexpr double kFaceSeconds = 4e-6;      // per face, before the first step
constexpr double kStateSeconds = 0.05e-6;  // per face whose state or sums a step's task reads
constexpr double kWarpSeconds = 32e-9;     // per reference pixel, partner and evaluation
constexpr double kDrawSeconds = 16e-9;     // per rendered face, view and iteration, at any level
constexpr double kMapSeconds = 28e-9;      // per crop pixel and evaluation
// In a tiled job, tasks also render occluders and repair around the core.
constexpr double kTileDrawShare = 1.6, kTileMendShare = 1.9;
constexpr double kSolveSeconds = 0.85e-6;   // per face and iteration
constexpr double kMendSeconds = 1.4e-6;     // per face and repair
constexpr double kLabelSeconds = 50e-9;     // per crop pixel and label step
constexpr double kLabelFaceSeconds = 2e-6;  // per face and label step
constexpr double kDecodeSeconds = 24e-9;    // per pixel of a whole photograph
// Classify, per pixel of the photograph; pixel and class; visible face.
constexpr double kClassifySeconds = 0.6e-6, kClassifyClassSeconds = 0.11e-6, kClassifyFaceSeconds = 0.5e-6;
constexpr double kClassifyPixelBytes = 140, kClassifyBytesPerFace = 250, kClassifyVisibleShare = 2;
constexpr double kStoredClassified = 0.6;  // per pixel and class
constexpr double kReadSeconds = 10e-9;     // per crop pixel and class

constexpr double kCutBytesPerCityFace = 240, kCutBytesPerFace = 160;
constexpr double kCutSecondsPerCityFace = 0.7e-6, kCutSecondsPerFace = 0.8e-6, kCutSecondsPerFaceView = 5e-9;
constexpr double kIngestBytesPerFace = 490, kIngestSecondsPerFaceView = 0.2e-6;
// The check of the scene's fit: bytes per pixel of the images that it keeps (common/check/fit_readings.cc).
constexpr double kFitPixelBytes = 2.3, kFitImages = 48, kFitImagePixels = 1.5e6;
// The second split: per face before and after.
constexpr double kSecondSplitBytesPerFace = 200, kSecondSplitSecondsPerFace = 2.5e-6;
constexpr double kPublishBytesPerFace = 90, kPublishSecondsPerFace = 2.6e-6;
constexpr double kFlipBytesPerFace = 110;  // of a tile; assumes one tile of up to kResidentFaces

// Compare: per cell, at all heights; two blocks in memory. Report: per cell.
constexpr double kCompareSeconds = 0.3e-3, kCompareBytes = 200 * kMiB, kChangeCellSeconds = 5e-6, kChangeCellBytes = 60;

// Stored bytes. Per crop pixel: photograph; likelihoods per class, both with their pyramids. Shares: size of the crops
// / predicted pixels, in an untiled and in a tiled job (at most the whole images).
constexpr double kStoredPixel = 8.0 / 3, kStoredPlanePixel = 4.0 / 3, kStoredCropShare = 1.08, kStoredRimShare = 1.8;
// Per face: package, in the core and outside; sums of measure (and per compared pixel, times the level's relative
// width); label sums, and per class; state between levels; state within a level.
constexpr double kStoredFace = 36, kStoredVisibleFace = 90, kStoredMeasuredFace = 32, kStoredPairPixel = 0.09;
constexpr double kStoredLabels = 8, kStoredClass = 4, kStoredState = 26.5, kStoredIteration = 44.5;
// City: per face, of the surface after the coarse levels, and per view of the survey; per published face, in one mesh
// and in tiles; per compared cell.
constexpr double kStoredCityFace = 38.5, kStoredMoved = 20, kStoredView = 2000, kStoredPublished = 40,
                 kStoredInTiles = 36, kStoredChangeCell = 50;

// Tasks mostly map the city's files, and the system evicts these pages when memory is short. So only kResidentFaces
// count in full; the rate for the others is what city_bench's tasks needed (tests/bench/scaling.md).
constexpr double kResidentFaces = 4 << 20, kBytesPerFaceBeyond = 12;

double CityBytes(double bytes_per_face, double faces) {
  return bytes_per_face * std::min(faces, kResidentFaces) + kBytesPerFaceBeyond * std::max(0.0, faces - kResidentFaces);
}

struct Box {
  Vector3d min, max;
};

// The part of a cell's box that may contain faces with a centroid at most `margin_m` from the core.
Box TilePart(const SurveyCell& cell, const GroundPlane& ground, const CellRect& core, double margin_m) {
  Box box = {cell.box_min, cell.box_max};
  if (ground.axis_x != Vector3d::UnitX() || ground.axis_y != Vector3d::UnitY()) return box;
  const double reach_m = margin_m + cell.reach_m;
  const double low[2] = {core.x0 * ground.cell_m - reach_m, core.y0 * ground.cell_m - reach_m};
  const double high[2] = {core.x1 * ground.cell_m + reach_m, core.y1 * ground.cell_m + reach_m};
  for (int k = 0; k < 2; ++k) {
    box.min[k] = std::clamp(low[k], box.min[k], box.max[k]);
    box.max[k] = std::clamp(high[k], box.min[k], box.max[k]);
  }
  return box;
}

// Share of a cell's square within `margin_m` of the core, along the axes.
double ShareWithin(const SurveyCell& cell, const CellRect& core, double margin_m, double cell_m) {
  const double margin = margin_m / cell_m;
  const double w = std::min<double>(cell.x + 1, core.x1 + margin) - std::max<double>(cell.x, core.x0 - margin);
  const double h = std::min<double>(cell.y + 1, core.y1 + margin) - std::max<double>(cell.y, core.y0 - margin);
  return std::clamp(w, 0.0, 1.0) * std::clamp(h, 0.0, 1.0);
}

// Pixels of the bounding rectangle of the boxes in the image; 0 if they are outside.
double CropPixels(const std::vector<Box>& boxes, const PosedCamera& camera, double margin_px) {
  const double width = camera.intrinsics.width, height = camera.intrinsics.height;
  double x0 = 1e300, y0 = 1e300, x1 = -1e300, y1 = -1e300;
  for (const Box& box : boxes) {
    for (int k = 0; k < 8; ++k) {
      const Vector3d corner(k & 1 ? box.max.x() : box.min.x(), k & 2 ? box.max.y() : box.min.y(),
                            k & 4 ? box.max.z() : box.min.z());
      const Vector3d p = camera.Project(corner);
      if (p.z() <= kNear_m) continue;
      x0 = std::min(x0, p.x());
      x1 = std::max(x1, p.x());
      y0 = std::min(y0, p.y());
      y1 = std::max(y1, p.y());
    }
  }
  const auto down = [margin_px](double x) {
    return std::floor((x - margin_px) / kCropAlignment_px) * kCropAlignment_px;
  };
  const auto up = [margin_px](double x) { return std::ceil((x + margin_px) / kCropAlignment_px) * kCropAlignment_px; };
  if (!(x1 > 0 && y1 > 0 && x0 < width && y0 < height)) return 0;
  return (std::min(up(x1), width) - std::max(down(x0), 0.0)) * (std::min(up(y1), height) - std::max(down(y0), 0.0));
}

constexpr CellRect kNoCells = {std::numeric_limits<int>::max(), std::numeric_limits<int>::max(),
                               std::numeric_limits<int>::min(), std::numeric_limits<int>::min()};

void Include(const CellRect& cells, CellRect* rect) {
  rect->x0 = std::min(rect->x0, cells.x0);
  rect->y0 = std::min(rect->y0, cells.y0);
  rect->x1 = std::max(rect->x1, cells.x1);
  rect->y1 = std::max(rect->y1, cells.y1);
}

// Grown by one cell on each side.
CellRect Grown(const CellRect& rect) { return {rect.x0 - 1, rect.y0 - 1, rect.x1 + 1, rect.y1 + 1}; }

// Number of faces in rectangles of cells: summed-area table (Crow 1984).
class FaceTable {
 public:
  // For rectangles within `all`.
  FaceTable(const CellIndex& cells, const CellRect& all)
      : all_(all), columns_(static_cast<size_t>(all.x1 - all.x0) + 1) {
    sums_.resize(columns_ * (static_cast<size_t>(all.y1 - all.y0) + 1));
    cells.ForEachIn(all, [&](const SurveyCell& cell) { At(cell.x + 1, cell.y + 1) = static_cast<double>(cell.faces); });
    for (int y = all.y0 + 1; y <= all.y1; ++y) {
      for (int x = all.x0 + 1; x <= all.x1; ++x) At(x, y) += At(x - 1, y) + At(x, y - 1) - At(x - 1, y - 1);
    }
  }

  double In(const CellRect& rect) {
    return At(rect.x1, rect.y1) - At(rect.x0, rect.y1) - At(rect.x1, rect.y0) + At(rect.x0, rect.y0);
  }

 private:
  // Sum over all cells left of x and below y.
  double& At(int x, int y) {
    return sums_[static_cast<size_t>(y - all_.y0) * columns_ + static_cast<size_t>(x - all_.x0)];
  }

  const CellRect all_;
  const size_t columns_;
  std::vector<double> sums_;
};

// Bytes per pixel of the whole file while it is read.
double DecodedLikelihoodBytes(const std::string& path, int planes) {
  if (path.ends_with(".npy")) return kArrayBytes * planes;
  return path.ends_with(".png") ? kLabelBytes : 0;
}

// Memory of the images that two threads load at the same time (ItemsAtOnce).
double ImagesBytes(double bytes_each) { return std::max(bytes_each, std::min(2 * bytes_each, kAheadBytes)); }

// Memory of the views in iterations.
double PixelBytes(const TileWork& work, const RefineEffort& effort, double windows) {
  const double packed_planes = 4.0 * ((work.likelihood_planes + 3) / 4);
  const double bytes = effort.finest_share * windows * (kOpenPixelBytes + packed_planes);
  const double ahead = std::min(kViewsAhead * work.largest_crop, work.pixels - work.open_pixels);
  return std::sqrt(effort.finest_share) * kContourBytes * work.pixels + bytes * work.open_pixels +
         std::min(bytes * ahead, kAheadBytes);
}

// Memory of the views and the sums of a label step.
double LabelBytes(const TileWork& work, const RefineEffort& effort) {
  if (effort.labellings == 0) return 0;
  return kLabelPackageBytes * work.package_faces +
         ImagesBytes((kLabelPixelBytes + 4 * work.likelihood_planes) * work.largest_crop);
}

bool IsOnlyTile(const TileWork& work) { return work.visible_faces < work.core_faces + 1; }

// Rendering and comparison of views.
double MeasureSeconds(const TileWork& work, const RefineEffort& effort) {
  const double draw =
      kDrawSeconds * work.drawn_faces * effort.iterations + kMapSeconds * work.pixels * effort.evaluations;
  return kWarpSeconds * work.pair_pixels * effort.warps + kLabelSeconds * work.pixels * effort.labellings +
         (IsOnlyTile(work) ? 1 : kTileDrawShare) * draw;
}

int64_t Bytes(double bytes) { return static_cast<int64_t>(bytes); }

double SolveSeconds(double faces, const RefineEffort& effort) {
  return faces * (kSolveSeconds * effort.iterations + kLabelFaceSeconds * effort.labellings);
}

}  // namespace

TileWork WithFaces(TileWork work, double share) {
  for (double* faces : {&work.core_faces, &work.solve_faces, &work.visible_faces, &work.package_faces,
                        &work.fine_package_faces, &work.drawn_faces}) {
    *faces *= share;
  }
  return work;
}

TileWork InFinePart(TileWork work) {
  work.package_faces = work.fine_package_faces;
  return work;
}

TileWork MeasureTile(const CellIndex& cells, const CellRect& core) {
  const Survey& survey = cells.survey();
  const double cell_m = survey.ground.cell_m, apron_m = kApronGsd * survey.gsd_m, solve_m = kSolveGsd * survey.gsd_m,
               visible_m = kVisibleSetGsd * survey.gsd_m, package_m = kPackageGsd * survey.gsd_m;
  TileWork work;
  cells.ForEachWithin(core, package_m, [&](const SurveyCell& cell) {
    const double faces = static_cast<double>(cell.faces);
    work.package_faces += faces * ShareWithin(cell, core, package_m, cell_m);
    work.fine_package_faces += faces * ShareWithin(cell, core, kFinePackageGsd * survey.gsd_m, cell_m);
  });
  std::vector<Box> boxes;
  std::set<int32_t> views;
  std::vector<const SurveyCell*> measured;  // cells whose faces the tile measures
  const SurveyCell* sample = nullptr;
  cells.ForEachWithin(core, visible_m, [&](const SurveyCell& cell) {
    const double faces = static_cast<double>(cell.faces);
    work.visible_faces += faces * ShareWithin(cell, core, visible_m, cell_m);
    work.solve_faces += faces * ShareWithin(cell, core, solve_m, cell_m);
    if (DistanceBetween({cell.x, cell.y, cell.x + 1, cell.y + 1}, core, cell_m) > apron_m) return;
    boxes.push_back(TilePart(cell, survey.ground, core, apron_m));
    views.insert(cell.views.begin(), cell.views.end());
    sample = BetterSampleCell(sample, cell, core);
    if (!core.Contains({cell.x, cell.y})) return;
    work.core_faces += faces;
    measured.push_back(&cell);
  });
  if (sample != nullptr) measured.push_back(sample);
  std::map<int32_t, std::vector<Box>> chosen;  // boxes of the cells that chose the view
  std::map<int32_t, CellRect> drawn;           // bounds of the cells that chose the view or a partner of it
  for (const SurveyCell* cell : measured) {
    for (const int32_t v : cell->views) {
      chosen[v].push_back({cell->box_min, cell->box_max});
      Include({cell->x, cell->y, cell->x + 1, cell->y + 1}, &drawn.try_emplace(v, kNoCells).first->second);
    }
  }
  const std::map<int32_t, CellRect> of_references = drawn;
  for (const auto& [reference, other] : survey.pairs) {
    const auto found = of_references.find(reference);
    if (found == of_references.end()) continue;
    views.insert(other);
    Include(found->second, &drawn.try_emplace(other, kNoCells).first->second);
  }
  work.views.assign(views.begin(), views.end());
  work.likelihood_planes = survey.has_likelihoods ? static_cast<int>(survey.classes.size()) : 0;
  std::map<int32_t, double> crop;
  for (const int32_t v : work.views) {
    const PosedCamera& camera = survey.views[v].camera;
    const double pixels = CropPixels(boxes, camera, kCropMargin_px);
    if (pixels <= 0) continue;
    crop[v] = pixels;
    work.largest_crop = std::max(work.largest_crop, pixels);
    const double whole = static_cast<double>(camera.intrinsics.width) * camera.intrinsics.height;
    work.pixels += pixels;
    work.image_pixels += whole;
    const double likelihoods = DecodedLikelihoodBytes(survey.views[v].likelihood_path, work.likelihood_planes);
    work.largest_decoded = std::max(work.largest_decoded, whole * std::max(kImageBytes, likelihoods));
  }
  work.seeing_views = static_cast<int>(crop.size());
  std::map<int32_t, double> compared;  // pixels per reference
  for (const auto& [v, of_view] : chosen) {
    compared[v] = CropPixels(of_view, survey.views[v].camera, kReferenceMargin_px);
  }
  CellRect all = kNoCells;
  for (const auto& [v, rect] : drawn) Include(Grown(rect), &all);
  if (drawn.empty()) all = {};
  FaceTable faces(cells, all);
  for (const auto& [v, rect] : drawn) {
    if (crop.contains(v)) work.drawn_faces += faces.In(Grown(rect));
  }
  std::map<int32_t, std::pair<int32_t, int32_t>> open;  // per view: first and last step that needs it
  for (const auto& [v, pixels] : crop) open[v] = {v, v};
  for (const auto& [reference, other] : survey.pairs) {
    if (!crop.contains(reference) || !crop.contains(other)) continue;
    if (const auto found = compared.find(reference); found != compared.end()) work.pair_pixels += found->second;
    auto& [first, last] = open[other];
    first = std::min(first, reference);
    last = std::max(last, reference);
  }
  std::map<int32_t, double> change;  // of the open pixels, by step
  for (const auto& [v, steps] : open) {
    change[steps.first] += crop[v];
    change[steps.second + 1] -= crop[v];
  }
  double now = 0;
  for (const auto& [step, pixels] : change) work.open_pixels = std::max(work.open_pixels, now += pixels);
  return work;
}

Prediction PredictRefine(const TileWork& work, const RefineEffort& effort) {
  Prediction prediction;
  prediction.peak_bytes = Bytes(kFixedBytes + kRefineBytesPerFace * work.core_faces +
                                std::max(PixelBytes(work, effort, kRefineWindows), LabelBytes(work, effort)));
  prediction.core_seconds = kTaskSeconds + kFaceSeconds * work.core_faces + MeasureSeconds(work, effort) +
                            SolveSeconds(work.core_faces, effort) + kMendSeconds * work.core_faces * effort.mends;
  prediction.stored_bytes = Bytes(kStoredState * work.core_faces);
  return prediction;
}

Prediction PredictMeasure(const TileWork& work, const RefineEffort& effort) {
  const double tasks = effort.iterations + effort.labellings;
  const double pixel_bytes = std::max(PixelBytes(work, effort, kMeasureWindows), LabelBytes(work, effort));
  return {tasks * (kTaskSeconds + kStateSeconds * work.visible_faces) + MeasureSeconds(work, effort),
          Bytes(kFixedBytes + kMeasureBytesPerFace * work.core_faces + kMeasurePackageBytes * work.package_faces +
                pixel_bytes),
          Bytes(effort.iterations * kStoredMeasuredFace * work.core_faces +
                effort.widths * kStoredPairPixel * work.pair_pixels +
                effort.labellings * (kStoredLabels + kStoredClass * work.likelihood_planes) * work.core_faces)};
}

Prediction PredictSolve(const TileWork& work, const RefineEffort& effort) {
  const double tasks = effort.iterations + effort.labellings;
  return {tasks * (kTaskSeconds + 2 * kStateSeconds * work.solve_faces) + SolveSeconds(work.solve_faces, effort),
          Bytes(kFixedBytes + kSolveBytesPerFace * work.solve_faces + kSolvePackageBytes * work.package_faces),
          Bytes((effort.iterations * kStoredIteration + effort.labellings * kStoredState) * work.core_faces)};
}

Prediction PredictMend(const TileWork& work, const RefineEffort& effort) {
  return {effort.mends * (kTaskSeconds + (kStateSeconds + kTileMendShare * kMendSeconds) * work.solve_faces),
          Bytes(kFixedBytes + kMendBytesPerFace * work.package_faces),
          Bytes(effort.mends * kStoredState * work.core_faces)};
}

Prediction PredictCrop(const TileWork& work) {
  const int planes = work.likelihood_planes;
  const double stored_pixels =
      IsOnlyTile(work) ? kStoredCropShare * work.pixels : std::min(kStoredRimShare * work.pixels, work.image_pixels);
  return {kTaskSeconds + kDecodeSeconds * work.image_pixels + kReadSeconds * planes * work.pixels,
          Bytes(kFixedBytes + kLoadBytesPerFace * work.visible_faces +
                ImagesBytes(kCropBytes * (1 + planes) * work.largest_crop + work.largest_decoded)),
          Bytes((kStoredPixel + kStoredPlanePixel * planes) * stored_pixels)};
}

Prediction PredictFineCrop(const TileWork& work) { return {kTaskSeconds, PredictCrop(work).peak_bytes, 0}; }

Prediction PredictCut(const Survey& survey, const TileWork& work) {
  const double city = static_cast<double>(survey.faces);
  return {
      kTaskSeconds + kCutSecondsPerCityFace * city +
          (kCutSecondsPerFace + kCutSecondsPerFaceView * work.seeing_views) * work.visible_faces,
      Bytes(kFixedBytes + CityBytes(kCutBytesPerCityFace, city) + kCutBytesPerFace * work.visible_faces),
      Bytes(kStoredFace * work.core_faces + kStoredVisibleFace * std::max(0.0, work.visible_faces - work.core_faces))};
}

Prediction PredictIngest(const Survey& survey) {
  double face_views = 0;
  for (const SurveyCell& cell : survey.cells) {
    face_views += static_cast<double>(cell.faces) * static_cast<double>(cell.views.size());
  }
  // If the job classifies, ingest reads no likelihoods, but the colours of the photographs.
  const double planes = !survey.classifier.empty() ? 1
                        : survey.has_likelihoods   ? static_cast<double>(survey.classes.size())
                                                   : 0;
  double pixels = 0, largest = 0;  // of all views: ingest checks each file
  for (const SceneView& view : survey.views) {
    const double of_view = static_cast<double>(view.camera.intrinsics.width) * view.camera.intrinsics.height;
    pixels += of_view;
    largest = std::max(largest, of_view);
  }
  const double kept =
      std::min(static_cast<double>(survey.views.size()), kFitImages) * std::min(largest, kFitImagePixels);
  return {
      kDecodeSeconds * (1 + planes) * pixels + kIngestSecondsPerFaceView * face_views,
      Bytes(kFixedBytes + CityBytes(kIngestBytesPerFace, static_cast<double>(survey.faces)) + kFitPixelBytes * kept),
      Bytes(kStoredCityFace * static_cast<double>(survey.faces) +
            kStoredView * static_cast<double>(survey.views.size()))};
}

std::vector<Prediction> PredictClassify(const Survey& survey) {
  std::vector<double> chosen(survey.views.size(), 0);  // faces of the cells that chose the view
  double by_any = 0;
  for (const SurveyCell& cell : survey.cells) {
    for (const int32_t v : cell.views) chosen[v] += static_cast<double>(cell.faces);
    by_any += static_cast<double>(cell.faces) * static_cast<double>(cell.views.size());
  }
  const double classes = static_cast<double>(survey.classes.size());
  std::vector<Prediction> predictions;
  for (size_t v = 0; v < chosen.size(); ++v) {
    const PinholeCamera& camera = survey.views[v].camera.intrinsics;
    const double pixels = static_cast<double>(camera.width) * camera.height;
    // A view that no cell chose is assumed to show an average number of faces.
    const double about = chosen[v] > 0 ? chosen[v] : by_any / static_cast<double>(chosen.size());
    const double faces = std::min(kClassifyVisibleShare * about, static_cast<double>(survey.faces));
    predictions.push_back(
        {kTaskSeconds + (kClassifySeconds + kClassifyClassSeconds * classes) * pixels + kClassifyFaceSeconds * faces,
         Bytes(kFixedBytes + kClassifyPixelBytes * pixels + kClassifyBytesPerFace * faces),
         Bytes(kStoredClassified * classes * pixels)});
  }
  return predictions;
}

Prediction PredictSplit(double faces, double fine_faces) {
  const double all = faces + fine_faces;
  return {kTaskSeconds + kSecondSplitSecondsPerFace * all,
          Bytes(kFixedBytes + CityBytes(kSecondSplitBytesPerFace, all)),
          Bytes((kStoredCityFace + kStoredMoved) * fine_faces)};
}

Prediction PredictStart(const Survey& survey, const TileWork& work) {
  const double city = static_cast<double>(survey.faces);
  return {kTaskSeconds + kCutSecondsPerCityFace * city + kStateSeconds * work.core_faces,
          Bytes(kFixedBytes + CityBytes(kCutBytesPerCityFace, city)), Bytes(kStoredState * work.core_faces)};
}

Prediction PredictPublish(const Survey& survey) {
  const double faces = static_cast<double>(survey.faces);
  return {kTaskSeconds + kPublishSecondsPerFace * faces,
          Bytes(kFixedBytes + CityBytes(kPublishBytesPerFace + kFlipBytesPerFace, faces)),
          Bytes((kStoredPublished + kStoredInTiles) * faces)};
}

Prediction PredictCompare(const Survey& survey, double image_pixels, double cells) {
  const double planes = survey.has_likelihoods ? static_cast<double>(survey.classes.size()) : 0;
  return {kTaskSeconds + kDecodeSeconds * (1 + planes) * image_pixels + kCompareSeconds * cells,
          Bytes(kFixedBytes + kCompareBytes + 4 * (1 + planes) * image_pixels),
          Bytes(kStoredChangeCell * kBlockCells * kBlockCells)};
}

Prediction PredictChanges(const Survey& survey, double blocks) {
  const double cells = blocks * kBlockCells * kBlockCells;
  return {kTaskSeconds + kChangeCellSeconds * cells,
          Bytes(kFixedBytes + CityBytes(kPublishBytesPerFace, static_cast<double>(survey.faces)) +
                kChangeCellBytes * cells),
          Bytes(kStoredChangeCell * cells)};
}

int64_t LeastTileBytes(double faces) { return Bytes(kFixedBytes + (kSolveBytesPerFace + kSolvePackageBytes) * faces); }

}  // namespace tessera
