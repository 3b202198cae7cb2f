#include "common/synth/synth.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <unordered_map>

#include "common/base/parallel.h"
#include "common/base/random.h"
#include "common/imaging/image_io.h"
#include "common/storage/files.h"
#include "common/synth/city/base_city.h"
#include "common/synth/city/epoch_changes.h"
#include "common/synth/labels/noise_calibration.h"
#include "common/synth/photos/sparse_points.h"
#include "common/synth/start_mesh/mesh_spool.h"
#include "common/synth/synth_scene_files.h"

namespace tessera {
namespace {

constexpr int kCellBlocks = 6;  // scenes for ray casting have this many blocks per side, plus a margin
constexpr int kCalibrationBlocks = 16;
constexpr int64_t kSpeckFaces = 100;  // smaller components of the start mesh are removed
constexpr int kJpegQuality = 95;
constexpr int kPointsPerBlock = 450;

Status ValidateOptions(const SynthOptions& o) {
  Faults faults;
  const auto expect = [&](bool good, const std::string& message) {
    if (!good) faults.Add(absl::InvalidArgumentError(message));
  };
  expect(o.columns >= 1 && o.rows >= 1 && o.columns <= 400 && o.rows <= 400,
         "blocks: expected 1 to 400 columns and rows");
  expect(std::isfinite(o.gsd_m) && o.gsd_m >= 0.02 && o.gsd_m <= 0.6, "gsd: expected 0.02 to 0.6 metres");
  expect(o.image_width_px >= 64 && o.image_height_px >= 64 && o.image_width_px <= 20000 && o.image_height_px <= 20000,
         "image size: expected 64 to 20000 pixels per side");
  return faults.ToStatus();
}

// Removes an existing scene from the folder and creates its subfolders. FAILED_PRECONDITION if the folder is not empty
// and `overwrite` is false.
Status PrepareFolder(const std::string& folder, bool overwrite, bool with_images) {
  std::error_code error;
  if (std::filesystem::exists(folder, error) && !std::filesystem::is_directory(folder, error)) {
    return absl::FailedPreconditionError(folder + " is a file: choose another folder");
  }
  if (std::filesystem::is_directory(folder, error) && !std::filesystem::is_empty(folder, error)) {
    if (!overwrite)
      return absl::FailedPreconditionError(
          folder + " is not empty: choose another folder, or pass --force to overwrite the scene in it");
    for (const char* part : {"scene.json", "synth.json", "mesh.ply", "images", "likelihoods", "colmap", "truth"}) {
      TESSERA_RETURN_IF_ERROR(RemoveTree(folder + "/" + part));
    }
  }
  for (const char* part : {"", "/colmap", "/truth"}) TESSERA_RETURN_IF_ERROR(EnsureFolder(folder + part));
  if (with_images) {
    for (const char* part : {"/images", "/likelihoods"}) TESSERA_RETURN_IF_ERROR(EnsureFolder(folder + part));
  }
  return absl::OkStatus();
}

// Caches the solids of blocks until ForgetRowsBefore drops their row.
class BlockCache : public BlockSource {
 public:
  explicit BlockCache(const CityPlan& plan) : plan_(plan) {}

  const BlockSolids& Solids(int column, int row) const override {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      const auto place = blocks_.find({row, column});
      if (place != blocks_.end()) return *place->second;
    }
    auto block = std::make_unique<BlockSolids>(BuildBlock(plan_, column, row));
    block->surface = {};
    std::lock_guard<std::mutex> lock(mutex_);
    return *blocks_.try_emplace({row, column}, std::move(block)).first->second;
  }

  void ForgetRowsBefore(int row) {
    std::lock_guard<std::mutex> lock(mutex_);
    blocks_.erase(blocks_.begin(), blocks_.lower_bound({row, 0}));
  }

 private:
  const CityPlan& plan_;
  mutable std::mutex mutex_;
  mutable std::map<std::pair<int, int>, std::unique_ptr<BlockSolids>> blocks_;
};

CityPlan PlanOf(const SynthOptions& o) { return {o.columns, o.rows, o.seed, o.gsd_m, nullptr}; }

Eigen::AlignedBox2d ExtentOf(const CityPlan& plan) {
  return {Eigen::Vector2d(plan.MinX(), plan.MinY()), Eigen::Vector2d(plan.MaxX(), plan.MaxY())};
}

// The inputs of a second epoch.
struct LaterEpoch {
  const SecondEpochOptions& options;
  const BaseCity& base;
  Eigen::AlignedBox2d part;
  ChangedCity city;

  bool whole() const { return options.whole || options.new_mesh; }
  uint64_t Salt() const { return MixBits(options.seed ^ 0x6e657874ull); }
};

class CitySynthesizer {
 public:
  CitySynthesizer(const SynthOptions& options, const std::string& folder, const TaskControl& control)
      : options_(options),
        folder_(folder),
        control_(control),
        plan_(PlanOf(options)),
        area_(ExtentOf(plan_)),
        grid_(MakeGroundGrid(plan_)),
        blocks_(plan_),
        flight_(PlanFlight(plan_, options.image_width_px, options.image_height_px)) {}

  CitySynthesizer(const LaterEpoch& epoch, const std::string& folder, const TaskControl& control)
      : options_(epoch.base.options),
        folder_(folder),
        control_(control),
        epoch_(&epoch),
        plan_(epoch.city.plan),
        area_(epoch.part),
        grid_(MakeGroundGrid(plan_)),
        blocks_(plan_),
        flight_(PlanFlightOver(plan_, area_, plan_.seed ^ epoch.Salt(), std::string(kLaterFlight) + "_",
                               options_.image_width_px, options_.image_height_px)) {}

  StatusOr<SynthReport> Run() {
    report_.gsd_m = options_.gsd_m;
    report_.voxel_m = kVoxelPerGsd * options_.gsd_m;
    report_.area_m2 = plan_.Blocks() * CityPlan::kPitch * CityPlan::kPitch;
    report_.images = options_.with_images ? static_cast<int64_t>(flight_.size()) : 0;
    TESSERA_RETURN_IF_ERROR(WriteTruthMesh());
    if (epoch_ != nullptr) {
      TESSERA_RETURN_IF_ERROR(WriteChanges(folder_ + "/truth/changes.geojson", epoch_->city.changes));
      for (const CityChange& change : epoch_->city.changes) ++report_.changes[static_cast<int>(change.kind)];
    }
    TESSERA_RETURN_IF_ERROR(Calibrate());
    if (MakesStartMesh()) {
      TESSERA_RETURN_IF_ERROR(WriteStartMesh());
    } else if (epoch_->whole()) {
      TESSERA_RETURN_IF_ERROR(LinkFile(epoch_->options.base_folder + "/mesh.ply", folder_ + "/mesh.ply"));
      report_.start_faces = epoch_->base.report.start_faces;
      report_.start_accuracy_by_area = epoch_->base.report.start_accuracy_by_area;
      report_.start_accuracy_by_pixels = epoch_->base.report.start_accuracy_by_pixels;
    }
    if (options_.with_images) {
      TESSERA_RETURN_IF_ERROR(WriteViews());
    }
    report_.sparse_points = static_cast<int64_t>(points_.size());
    TESSERA_RETURN_IF_ERROR(WriteCameras());
    TESSERA_RETURN_IF_ERROR(control_.Check());
    std::filesystem::path named = std::filesystem::path(folder_).lexically_normal();
    if (named.filename().empty()) named = named.parent_path();
    std::optional<EpochFiles> files;
    if (epoch_ != nullptr) files.emplace(EpochFiles{epoch_->options, epoch_->city.changes});
    TESSERA_RETURN_IF_ERROR(
        WriteSceneJson(folder_, named.filename().string(), options_, report_, files ? &*files : nullptr));
    return report_;
  }

 private:
  bool MakesStartMesh() const { return epoch_ == nullptr || epoch_->options.new_mesh; }

  uint64_t ViewSeed(size_t view) const {
    return MixBits(plan_.seed ^ MixBits((epoch_ == nullptr ? 0x76696577ull : epoch_->Salt()) + view));
  }

  // Writes the COLMAP model. For a complete scene, it starts with the base city's cameras, and their images are linked.
  Status WriteCameras() {
    if (epoch_ == nullptr || !epoch_->whole()) return WriteColmapText(folder_ + "/colmap", flight_, ".jpg", points_);
    const std::string& base = epoch_->options.base_folder;
    for (const char* part : {"/images", "/likelihoods"}) {
      TESSERA_RETURN_IF_ERROR(LinkFiles(base + part, folder_ + part));
    }
    TESSERA_ASSIGN_OR_RETURN(const ColmapText earlier, ReadColmapText(base + "/colmap"));
    report_.images += earlier.image_count;
    report_.sparse_points += earlier.point_count;
    return WriteColmapText(folder_ + "/colmap", flight_, ".jpg", points_, &earlier);
  }

  Status WriteTruthMesh() {
    MeshSpool spool(folder_ + "/truth/mesh");
    for (size_t j = 0; j < grid_.y_lines.size(); ++j) {
      for (size_t i = 0; i < grid_.x_lines.size(); ++i) spool.AddVertex(GroundVertex(plan_, grid_, i, j));
    }
    for (size_t j = 0; j + 1 < grid_.y_lines.size(); ++j) {
      for (size_t i = 0; i + 1 < grid_.x_lines.size(); ++i) {
        const auto v = [&](size_t di, size_t dj) { return static_cast<uint32_t>(grid_.Vertex(i + di, j + dj)); };
        const int32_t label = GroundCellLabel(plan_, grid_, i, j);
        spool.AddFace({v(0, 0), v(1, 0), v(1, 1)}, label);
        spool.AddFace({v(0, 0), v(1, 1), v(0, 1)}, label);
      }
    }
    for (int row = 0; row < plan_.rows; ++row) {
      control_.Report(0.03 * row / plan_.rows, "true surface");
      TESSERA_RETURN_IF_ERROR(control_.Check());
      std::vector<TriangleMesh> meshes(plan_.columns);
      ParallelForEach(plan_.columns, 1, [&](int c) { meshes[c] = BuildBlock(plan_, c, row).surface.mesh; });
      for (const TriangleMesh& mesh : meshes) {
        const uint32_t first = static_cast<uint32_t>(spool.vertex_count());
        for (const Eigen::Vector3d& p : mesh.vertices) spool.AddVertex(p);
        for (size_t f = 0; f < mesh.faces.size(); ++f) {
          const Triangle& t = mesh.faces[f];
          spool.AddFace({t[0] + first, t[1] + first, t[2] + first}, mesh.labels[f]);
        }
      }
    }
    report_.truth_faces = spool.face_count();
    return WriteSpooledPly(folder_ + "/truth/mesh.ply", spool);
  }

  // Number of blocks around a target that views and shadows can reach.
  int ViewMargin() const {
    const double height_m = 1.1 * options_.image_width_px * options_.gsd_m;
    return static_cast<int>(std::ceil((1.1 * height_m + 40) / CityPlan::kPitch));
  }

  std::shared_ptr<const CityScene> SceneAround(const BlockRange& range) {
    const BlockRange grown = range.Grown(plan_, ViewMargin());
    const std::array<int, 4> key = {grown.column_low, grown.column_high, grown.row_low, grown.row_high};
    if (!scene_ || key != scene_key_) {
      scene_.reset();
      scene_ = std::make_shared<CityScene>(plan_, grid_, grown);
      scene_key_ = key;
    }
    return scene_;
  }

  std::vector<int> ViewsOver(const BlockRange& range) const {
    std::vector<int> views;
    for (size_t k = 0; k < flight_.size(); ++k) {
      const auto [column, row] = plan_.BlockAt(flight_[k].target.head<2>());
      if (range.Contains(column, row)) views.push_back(static_cast<int>(k));
    }
    return views;
  }

  // The blocks that overlap the area.
  BlockRange AreaBlocks() const {
    const auto low = [](double from) { return static_cast<int>(std::floor(from / CityPlan::kPitch + 1e-9)); };
    const auto high = [](double to) { return static_cast<int>(std::ceil(to / CityPlan::kPitch - 1e-9)); };
    return {low(area_.min().x() - plan_.MinX()), high(area_.max().x() - plan_.MinX()),
            low(area_.min().y() - plan_.MinY()), high(area_.max().y() - plan_.MinY())};
  }

  // About sixteen blocks in the middle of the area, as square as the area permits.
  BlockRange CalibrationRange() const {
    const BlockRange area = AreaBlocks();
    const int area_rows = area.row_high - area.row_low, area_columns = area.column_high - area.column_low;
    const int rows = std::min(area_rows, std::max(kCalibrationBlocks / std::min(area_columns, 4), 4));
    const int columns = std::min(area_columns, std::max(kCalibrationBlocks / rows, 1));
    BlockRange range;
    range.column_low = area.column_low + (area_columns - columns) / 2;
    range.column_high = range.column_low + columns;
    range.row_low = area.row_low + (area_rows - rows) / 2;
    range.row_high = range.row_low + rows;
    return range;
  }

  // The start label threshold of the base city; with it, labels are equal where nothing has changed.
  StatusOr<double> BaseStartThreshold() const {
    TaskControl quiet;
    quiet.cancelled = control_.cancelled;
    CitySynthesizer first(epoch_->base.options, folder_, quiet);
    TESSERA_RETURN_IF_ERROR(first.Calibrate());
    return first.start_threshold_;
  }

  Status Calibrate() {
    control_.Report(0.03, "calibration");
    TESSERA_RETURN_IF_ERROR(control_.Check());
    const BlockRange range = CalibrationRange();
    std::vector<std::pair<int, int>> block_indices;
    for (int row = range.row_low; row < range.row_high && MakesStartMesh(); ++row) {
      for (int column = range.column_low; column < range.column_high; ++column) block_indices.push_back({row, column});
    }
    std::vector<StartChunk> chunks(block_indices.size());
    ParallelForEach(block_indices.size(), 1, [&](size_t k) {
      chunks[k] = ExtractStartChunk(plan_, blocks_, block_indices[k].second, block_indices[k].first);
    });
    std::vector<const StartChunk*> pointers;
    for (const StartChunk& chunk : chunks) pointers.push_back(&chunk);
    std::vector<StartLabelSample> samples;
    if (options_.with_images) {
      const auto scene = SceneAround(range);
      const std::vector<int> over = ViewsOver(range);
      const auto spread = [&](size_t count) {
        std::vector<int> chosen;
        for (size_t k = 0; k < std::min(count, over.size()); ++k)
          chosen.push_back(over[k * over.size() / std::min(count, over.size())]);
        return chosen;
      };
      std::vector<const SynthView*> views;
      for (int k : spread(40)) views.push_back(&flight_[k]);
      if (MakesStartMesh()) samples = SampleStartLabels(*scene, pointers, views, 15000, range);
      std::vector<const SynthView*> few;
      std::vector<uint64_t> seeds;
      for (int k : spread(10)) {
        few.push_back(&flight_[k]);
        seeds.push_back(ViewSeed(k));
      }
      control_.Report(0.06, "calibration");
      likelihood_threshold_ = CalibrateLikelihoods(*scene, few, seeds);
    }
    if (!MakesStartMesh()) return absl::OkStatus();
    if (epoch_ == nullptr) {
      start_threshold_ = CalibrateStartLabels(pointers, samples);
    } else {
      TESSERA_ASSIGN_OR_RETURN(start_threshold_, BaseStartThreshold());
    }
    if (!samples.empty())
      report_.start_accuracy_by_pixels = CountByPixels(pointers, samples, start_threshold_).AverageAccuracy();
    for (size_t k = 0; k < block_indices.size(); ++k) ready_chunks_[block_indices[k]] = std::move(chunks[k]);
    return absl::OkStatus();
  }

  Status WriteStartMesh() {
    MeshSpool raw(folder_ + "/mesh.raw"), shell(folder_ + "/mesh");
    ClassConfusion by_area;
    std::unordered_map<uint64_t, uint32_t> border, next_border;  // vertices that later chunks may share
    for (int row = 0; row < plan_.rows; ++row) {
      control_.Report(0.1 + 0.08 * row / plan_.rows, "start mesh");
      TESSERA_RETURN_IF_ERROR(control_.Check());
      blocks_.ForgetRowsBefore(row - 1);
      std::vector<StartChunk> chunks(plan_.columns);
      ParallelForEach(plan_.columns, 1, [&](int c) {
        const auto ready = ready_chunks_.find({row, c});
        chunks[c] = ready != ready_chunks_.end() ? std::move(ready->second) : ExtractStartChunk(plan_, blocks_, c, row);
      });
      for (const StartChunk& chunk : chunks) {
        AddByArea(chunk, start_threshold_, by_area);
        std::vector<uint32_t> index(chunk.vertices.size());
        for (size_t v = 0; v < chunk.vertices.size(); ++v) {
          if (chunk.on_border[v]) {
            const auto before = border.find(chunk.keys[v]);
            const auto [place, fresh] = next_border.try_emplace(
                chunk.keys[v], before != border.end() ? before->second : static_cast<uint32_t>(raw.vertex_count()));
            index[v] = place->second;
            if (!fresh || before != border.end()) continue;
          }
          index[v] = static_cast<uint32_t>(raw.vertex_count());
          raw.AddVertex(chunk.vertices[v]);
        }
        for (size_t f = 0; f < chunk.faces.size(); ++f) {
          const Triangle& t = chunk.faces[f];
          raw.AddFace({index[t[0]], index[t[1]], index[t[2]]}, StartLabel(chunk, f, start_threshold_));
        }
      }
      border = std::move(next_border);
      next_border.clear();
    }
    ready_chunks_.clear();
    TESSERA_RETURN_IF_ERROR(DropSmallComponents(raw, kSpeckFaces, shell));
    report_.start_faces = shell.face_count();
    report_.start_accuracy_by_area = by_area.AverageAccuracy();
    return WriteSpooledPly(folder_ + "/mesh.ply", shell);
  }

  Status WriteViews() {
    ArgmaxCount total;
    size_t done = 0;
    for (int row = 0; row < plan_.rows; row += kCellBlocks) {
      for (int column = 0; column < plan_.columns; column += kCellBlocks) {
        const BlockRange cell{column, std::min(plan_.columns, column + kCellBlocks), row,
                              std::min(plan_.rows, row + kCellBlocks)};
        const std::vector<int> views = ViewsOver(cell);
        if (views.empty()) continue;
        const auto scene = SceneAround(cell);
        const Eigen::AlignedBox2d square(plan_.BlockOrigin(cell.column_low, cell.row_low),
                                         plan_.BlockOrigin(cell.column_high, cell.row_high));
        const double blocks = square.intersection(area_).volume() / (CityPlan::kPitch * CityPlan::kPitch);
        const std::vector<SparsePoint> points = MakeSparsePoints(
            *scene, flight_, views, static_cast<int>(std::lround(kPointsPerBlock * std::max(0.0, blocks))),
            MixBits(plan_.seed) + (epoch_ == nullptr ? 0 : epoch_->Salt()) + static_cast<uint64_t>(row) * 100003 +
                column);
        points_.insert(points_.end(), points.begin(), points.end());
        std::vector<ArgmaxCount> counts(views.size());
        std::vector<Status> statuses(views.size());
        std::mutex mutex;
        ParallelForEach(views.size(), 1, [&](size_t k) {
          statuses[k] = control_.Check();
          if (statuses[k].ok()) statuses[k] = WriteView(*scene, views[k], &counts[k]);
          std::lock_guard<std::mutex> lock(mutex);
          ++done;
          control_.Report(0.18 + 0.8 * static_cast<double>(done) / static_cast<double>(flight_.size()), "images");
        });
        for (size_t k = 0; k < views.size(); ++k) {
          TESSERA_RETURN_IF_ERROR(statuses[k]);
          total.right += counts[k].right;
          total.all += counts[k].all;
        }
      }
    }
    report_.likelihood_accuracy =
        static_cast<double>(total.right) / static_cast<double>(std::max<int64_t>(1, total.all));
    return absl::OkStatus();
  }

  Status WriteView(const CityScene& scene, int index, ArgmaxCount* count) const {
    const SynthView& view = flight_[index];
    const RenderedView rendered = RenderView(scene, view, ViewSeed(index), true);
    TESSERA_RETURN_IF_ERROR(WriteJpeg(folder_ + "/images/" + view.stem + ".jpg", rendered.rgb, kJpegQuality));
    TESSERA_RETURN_IF_ERROR(WritePng(folder_ + "/truth/" + view.stem + "_label.png", rendered.labels));
    const ByteImage likelihoods =
        MakeLikelihoods(rendered, PixelDoubt(plan_, rendered, ViewSeed(index)), likelihood_threshold_);
    *count = CountArgmax(rendered, likelihoods);
    return WriteLikelihoodTiff(folder_ + "/likelihoods/" + view.stem + ".tif", likelihoods);
  }

  const SynthOptions& options_;
  const std::string folder_;
  const TaskControl& control_;
  const LaterEpoch* epoch_ = nullptr;  // null: first epoch
  const CityPlan plan_;
  const Eigen::AlignedBox2d area_;  // covered by the flight
  const GroundGrid grid_;
  BlockCache blocks_;
  const std::vector<SynthView> flight_;
  std::shared_ptr<const CityScene> scene_;
  std::array<int, 4> scene_key_{};
  std::map<std::pair<int, int>, StartChunk> ready_chunks_;
  std::vector<SparsePoint> points_;
  double start_threshold_ = 1, likelihood_threshold_ = 1;
  SynthReport report_;
};

}  // namespace

StatusOr<SynthReport> SynthesizeCity(const SynthOptions& options, const std::string& folder,
                                     const TaskControl& control) {
  TESSERA_RETURN_IF_ERROR(ValidateOptions(options));
  TESSERA_RETURN_IF_ERROR(PrepareFolder(folder, options.overwrite, options.with_images));
  return CitySynthesizer(options, folder, control).Run();
}

StatusOr<SynthReport> SynthesizeSecondEpoch(const SecondEpochOptions& options, const std::string& folder,
                                            const TaskControl& control) {
  const std::array<double, 4>& p = options.part;
  if (!(p[0] >= 0 && p[1] >= 0 && p[2] <= 1 && p[3] <= 1 && p[0] < p[2] && p[1] < p[3])) {
    return absl::InvalidArgumentError("part: expected X0,Y0,X1,Y1 with 0 <= X0 < X1 <= 1 and 0 <= Y0 < Y1 <= 1");
  }
  TESSERA_ASSIGN_OR_RETURN(const BaseCity base, ReadBaseCity(options.base_folder));
  TESSERA_RETURN_IF_ERROR(ValidateOptions(base.options));
  std::error_code error;
  if (std::filesystem::equivalent(options.base_folder, folder, error)) {
    return absl::InvalidArgumentError(folder + " is the folder of the base city: choose another output folder");
  }
  const CityPlan plan = PlanOf(base.options);
  const Eigen::AlignedBox2d extent = ExtentOf(plan);
  const auto at = [&](double x, double y) {
    return Eigen::Vector2d(extent.min() + extent.sizes().cwiseProduct(Eigen::Vector2d(x, y)));
  };
  LaterEpoch epoch{options, base, {at(p[0], p[1]), at(p[2], p[3])}, {}};
  control.Report(0, "changes");
  epoch.city = options.changes ? ChangeCity(plan, epoch.part, options.seed) : ChangedCity{plan, {}};
  if (options.changes && epoch.city.changes.empty())
    return absl::InvalidArgumentError("part: no object in it can be changed: choose a larger part");
  TESSERA_RETURN_IF_ERROR(PrepareFolder(folder, options.overwrite, true));
  return CitySynthesizer(epoch, folder, control).Run();
}

}  // namespace tessera
