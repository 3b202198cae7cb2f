#include "common/exporting/folder/export_folder.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <set>
#include <system_error>
#include <thread>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/base/machine_limits.h"
#include "common/base/parallel.h"
#include "common/exporting/color/color_sheet.h"
#include "common/exporting/export_map.h"
#include "common/exporting/folder/result_folder.h"
#include "common/exporting/folder/split_mesh_file.h"
#include "common/exporting/folder/staging.h"
#include "common/exporting/sheet_views.h"
#include "common/job/task_parameters.h"
#include "common/storage/files.h"
#include "common/storage/hash.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;
using IndexJson = nlohmann::ordered_json;

constexpr char kExportIndexFile[] = "export.json";
// Shares of the time.
constexpr double kSplitShare = 0.25, kStepShare = 0.35, kColorShare = 0.6, kSheetShare = 0.9, kJoinShare = 0.97;
// Memory of the work on a sheet: photographs and buffers, and per face. A format may take 2 GiB for 2 million faces.
constexpr int64_t kBytesPerWorker = int64_t{512} << 20, kBytesPerFace = 1024;

// Calls work(i) for each i < count on `workers` threads until one fails; returns the failure of the lowest i.
Status ForEachSheet(size_t count, int workers, const std::function<Status(size_t)>& work) {
  std::atomic<size_t> next = 0;
  std::atomic<bool> failed = false;
  std::vector<Status> statuses(count);
  const auto run = [&] {
    for (size_t i = next++; i < count && !failed; i = next++) {
      statuses[i] = work(i);
      if (!statuses[i].ok()) failed = true;
    }
  };
  std::vector<std::thread> threads;
  for (int t = 1; t < workers; ++t) threads.emplace_back(run);
  run();
  for (std::thread& thread : threads) thread.join();
  for (const Status& status : statuses) TESSERA_RETURN_IF_ERROR(status);
  return absl::OkStatus();
}

std::string SheetCount(size_t sheets) { return absl::StrCat(sheets, sheets == 1 ? " sheet" : " sheets"); }

// Moves files that a format wrote from `from` to `to`. INTERNAL if one is missing or already there.
Status MoveFiles(const std::vector<std::string>& names, const std::string& from, const std::string& to) {
  for (const std::string& name : names) {
    TESSERA_ASSIGN_OR_RETURN(const std::string source, JoinInside(from, name));
    TESSERA_ASSIGN_OR_RETURN(const std::string target, JoinInside(to, name));
    if (FileExists(target)) return absl::InternalError(absl::StrCat("two exported files have the name ", name));
    TESSERA_RETURN_IF_ERROR(EnsureFolder(fs::path(target).parent_path().string()));
    TESSERA_RETURN_IF_ERROR(RenameDurably(source, target));
  }
  return absl::OkStatus();
}

// One export, a member function a stage.
class FolderExport {
 public:
  FolderExport(const ExportRequest& request, std::span<const ExportFormat> table, Warnings* warnings,
               const TaskControl& control)
      : request_(request), options_(request.options), table_(table), warnings_(*warnings), control_(control) {}

  StatusOr<std::vector<ExportedFormat>> Run() {
    control_.Report(0, "checking");
    const Status opened = Open();
    const Status named = CheckFormatNames(options_, table_);
    if (!opened.ok() && !named.ok()) {
      Faults faults;
      faults.Add(named);
      faults.Add(opened);
      return faults.ToStatus();
    }
    TESSERA_RETURN_IF_ERROR(opened);
    TESSERA_RETURN_IF_ERROR(CheckBeforeWork());
    TESSERA_ASSIGN_OR_RETURN(const ExportStaging staging, ExportStaging::Open(request_.out));
    TESSERA_RETURN_IF_ERROR(CheckSpace());
    TESSERA_ASSIGN_OR_RETURN(result_sheets_, staging.Folder("result"));
    TESSERA_ASSIGN_OR_RETURN(start_sheets_, staging.Folder("start"));
    TESSERA_ASSIGN_OR_RETURN(step_sheets_, staging.Folder("step"));
    TESSERA_ASSIGN_OR_RETURN(files_, staging.Folder("files"));
    TESSERA_ASSIGN_OR_RETURN(work_, staging.Folder("work"));
    TESSERA_RETURN_IF_ERROR(Split());
    TESSERA_RETURN_IF_ERROR(Measure());
    TESSERA_RETURN_IF_ERROR(Color());
    TESSERA_RETURN_IF_ERROR(WriteSheets());
    TESSERA_RETURN_IF_ERROR(Join());
    TESSERA_ASSIGN_OR_RETURN(const std::vector<ExportedFormat> exported, WriteIndex());
    TESSERA_RETURN_IF_ERROR(control_.Check());
    TESSERA_RETURN_IF_ERROR(staging.Publish(files_, kExportIndexFile));
    return exported;
  }

 private:
  Status Open() {
    for (const std::string& name : options_.formats) {
      const ExportFormat* const format = FindExportFormat(name, table_);
      if (format == nullptr) continue;  // CheckExport names it
      formats_.push_back(format);
      needs_sheets_ |= format->write_sheet != nullptr || format->join_reads_sheets;
      needs_neighbours_ |= format->reads_neighbours;
      needs_photographs_ |= format->reads_photographs;
      wants_start_ |= format->reads_start;
      is_colored_ |= format->colored;
    }
    needs_colors_ = is_colored_ && options_.color == VertexColor::kImage;
    needs_photographs_ |= needs_colors_;
    wants_start_ |= is_colored_ && options_.color == VertexColor::kDisplacement;
    TESSERA_ASSIGN_OR_RETURN(result_, OpenResultFolder(request_.result, request_.scene, needs_photographs_));
    return absl::OkStatus();
  }

  Status CheckBeforeWork() {
    Faults faults;
    faults.Add(CheckExport(options_, result_.scene, table_));
    if (needs_photographs_ && !result_.described) {
      faults.Add(InputError("--scene", "", "none", "the folder of the scene: its photographs are needed"));
    }
    start_path_ = request_.start;
    if (start_path_.empty() && result_.described && !result_.described->mesh_path.empty()) {
      start_path_ = absl::StrCat(result_.described->folder, "/", result_.described->mesh_path);
    }
    if (start_path_.empty() && is_colored_ && options_.color == VertexColor::kDisplacement) {
      faults.Add(InputError("--color", "", "displacement without a start mesh",
                            "--scene SCENE, the scene of the result, or --start MESH"));
    }
    for (std::string& warning : ExportWarnings(options_, result_.scene, table_)) {
      warnings_.push_back(std::move(warning));
    }
    for (const ExportFormat* format : formats_) {
      if (format->reads_changes && result_.changes_path.empty()) {
        faults.Add(InputError(request_.result, "", "no file changes.geojson",
                              absl::StrCat("the result of an update with a new flight: only that has one, so leave "
                                           "out the format ",
                                           std::string(format->name))));
      }
      if (format->reads_start && start_path_.empty()) {
        left_out_.push_back(
            absl::StrCat(std::string(format->name), ": the start mesh, because neither --scene nor --start is given"));
      }
    }
    return faults.ToStatus();
  }

  // The least that the disk must have: sheets, their scratch files and one copy of the mesh a format.
  Status CheckSpace() const {
    if (!needs_sheets_) return absl::OkStatus();
    double needed = 0;
    for (const std::string& path : {result_.mesh_path, wants_start_ ? start_path_ : std::string()}) {
      if (path.empty()) continue;
      TESSERA_ASSIGN_OR_RETURN(const FileStamp stamp, StampOf(path));
      needed += 2 * static_cast<double>(stamp.size_bytes);
    }
    needed += needed / 2 * static_cast<double>(formats_.size());
    std::error_code error;
    const fs::space_info space = fs::space(request_.out, error);
    if (error || static_cast<double>(space.available) >= needed) return absl::OkStatus();
    constexpr double kGib = 1 << 30;
    return absl::ResourceExhaustedError(
        absl::StrFormat("%s: found %.2f GiB of free space, expected at least %.2f GiB for this export: free space, or "
                        "name a folder on another disk with --out",
                        request_.out, static_cast<double>(space.available) / kGib, needed / kGib));
  }

  Status Split() {
    if (!needs_sheets_) return FindBoxes();
    SplitFileOptions split;
    split.read.warnings = &warnings_;
    split.read.file_in_warnings = kMeshFile;
    split.read.confidence = true;
    split.scratch_folder = work_;
    split.sheets_folder = result_sheets_;
    for (const auto& [id, views] : result_.views_of_sheets) split.allowed.push_back(id);
    const bool has_start = wants_start_ && !start_path_.empty();
    const double middle = has_start ? kSplitShare / 2 : kSplitShare;
    TESSERA_ASSIGN_OR_RETURN(sheets_,
                             SplitMeshFile(result_.mesh_path, result_.scene, split, PartOf(control_, 0, middle)));
    TESSERA_RETURN_IF_ERROR(FindBoxes());
    int64_t largest = 0;
    size_t set_aside = 0;
    for (const SheetEntry& sheet : sheets_) {
      largest = std::max(largest, sheet.faces);
      set_aside += IsSetAside(result_, sheet.id);
    }
    if (set_aside > 0) {
      warnings_.push_back(absl::StrCat(set_aside, " of ", SheetCount(sheets_.size()),
                                       " may show tiles whose refinement failed: \"set_aside\" in export.json"));
    }
    const int64_t a_worker = kBytesPerWorker + kBytesPerFace * largest;
    workers_ = static_cast<int>(
        std::clamp<int64_t>(MemoryLimit_bytes() / 2 / a_worker, 1, std::min(CoreLimit(), ThreadCount())));
    if (!has_start) return absl::OkStatus();
    split.read.confidence = false;
    split.read.file_in_warnings = fs::path(start_path_).filename().string();
    if (result_.described) split.read.label_property = LabelPropertyOf(*result_.described, start_path_);
    split.sheets_folder = start_sheets_;
    split.allowed.clear();
    for (const SheetEntry& sheet : sheets_) split.allowed.push_back(sheet.id);
    TESSERA_ASSIGN_OR_RETURN(const std::vector<SheetEntry> start,
                             SplitMeshFile(start_path_, result_.scene, split, PartOf(control_, middle, kSplitShare)));
    for (const SheetEntry& sheet : start) start_ids_.push_back(sheet.id);
    return absl::OkStatus();
  }

  // The boxes of the sheets in the system of the export: a sheet that it does not cover is an error before work.
  Status FindBoxes() {
    TESSERA_ASSIGN_OR_RETURN(const ExportMap map, ExportMap::Open(result_.scene, options_.crs));
    crs_ = map.crs();
    warnings_.insert(warnings_.end(), map.warnings().begin(), map.warnings().end());
    Faults faults;
    for (const SheetEntry& sheet : sheets_) {
      const StatusOr<Eigen::AlignedBox3d> box =
          map.BoxFromLocal(sheet.box, absl::StrCat("sheet ", SheetName(sheet.id)));
      faults.Add(box.status());
      if (box.ok()) boxes_.push_back(*box);
    }
    return faults.ToStatus();
  }

  // Adds the displacements to the sheets.
  Status Measure() {
    if (start_ids_.empty()) return absl::OkStatus();
    return Step(kSplitShare, kStepShare, "measuring displacements", [&](size_t i, Sheet* sheet) -> Status {
      std::vector<Sheet> start;
      for (const SheetId& id : start_ids_) {
        if (std::abs(id.x - sheets_[i].id.x) > 1 || std::abs(id.y - sheets_[i].id.y) > 1) continue;
        TESSERA_ASSIGN_OR_RETURN(Sheet part, ReadSheet(SheetPath(start_sheets_, id)));
        start.push_back(std::move(part));
      }
      TESSERA_ASSIGN_OR_RETURN(sheet->displacement_m, DisplacementOf(*sheet, start));
      return absl::OkStatus();
    });
  }

  // Adds colours from photographs to the sheets.
  Status Color() {
    if (!needs_colors_) return absl::OkStatus();
    std::vector<double> unseen(sheets_.size());  // vertices of each sheet that no photograph shows
    const Status colored = Step(kStepShare, kColorShare, "colouring", [&](size_t i, Sheet* sheet) -> Status {
      TESSERA_ASSIGN_OR_RETURN(const SheetInput input, InputOf(i, /*neighbours=*/true, /*photographs=*/true));
      TESSERA_RETURN_IF_ERROR(ColorSheet(input, &sheet->colors, Quiet(), &unseen[i]));
      unseen[i] *= static_cast<double>(sheet->vertices.size());
      return absl::OkStatus();
    });
    TESSERA_RETURN_IF_ERROR(colored);
    double all = 0, without = 0;
    for (size_t i = 0; i < sheets_.size(); ++i) {
      all += static_cast<double>(sheets_[i].vertices);
      without += unseen[i];
    }
    if (without > 0) {
      warnings_.push_back(absl::StrFormat(
          "--color image: no photograph shows %.1f %% of the vertices; they have the colours around them",
          100 * without / all));
    }
    return absl::OkStatus();
  }

  // Changes all sheets of the result by `change`, which may read the sheets as they were before.
  Status Step(double low, double high, const std::string& stage, const std::function<Status(size_t, Sheet*)>& change) {
    const Status written = ForEach(low, high, stage, [&](size_t i) -> Status {
      TESSERA_ASSIGN_OR_RETURN(Sheet sheet, ReadSheet(SheetPath(result_sheets_, sheets_[i].id)));
      TESSERA_RETURN_IF_ERROR(change(i, &sheet));
      return WriteSheet(SheetPath(step_sheets_, sheets_[i].id), sheet);
    });
    TESSERA_RETURN_IF_ERROR(written);
    std::swap(result_sheets_, step_sheets_);
    return absl::OkStatus();
  }

  Status WriteSheets() {
    if (std::none_of(formats_.begin(), formats_.end(), [](const ExportFormat* f) { return f->write_sheet; })) {
      return absl::OkStatus();
    }
    return ForEach(kColorShare, kSheetShare, "writing", [&](size_t i) -> Status {
      TESSERA_ASSIGN_OR_RETURN(const SheetInput input, InputOf(i, needs_neighbours_, needs_photographs_));
      for (const ExportFormat* format : formats_) {
        if (format->write_sheet == nullptr) continue;
        const std::string folder = WorkFolder(*format, sheets_[i].id);
        TESSERA_RETURN_IF_ERROR(EnsureFolder(folder));
        TESSERA_ASSIGN_OR_RETURN(const std::vector<std::string> names, format->write_sheet(input, folder, Quiet()));
        TESSERA_RETURN_IF_ERROR(MoveFiles(names, folder, absl::StrCat(files_, "/", std::string(format->name))));
      }
      return absl::OkStatus();
    });
  }

  Status Join() {
    for (size_t f = 0; f < formats_.size(); ++f) {
      const ExportFormat& format = *formats_[f];
      if (format.join == nullptr) continue;
      TESSERA_RETURN_IF_ERROR(control_.Check());
      JoinInput input{result_.scene, options_};
      input.warnings = &warnings_;
      if (format.reads_changes) input.changes_path = result_.changes_path;
      for (const SheetEntry& sheet : sheets_) {
        JoinInput::Item& item = input.sheets.emplace_back();
        item.id = sheet.id;
        item.set_aside = IsSetAside(result_, sheet.id);
        if (format.join_reads_sheets) item.sheet_path = SheetPath(result_sheets_, sheet.id);
        if (format.has_part) item.part_path = absl::StrCat(WorkFolder(format, sheet.id), "/", kPartFile);
      }
      const double share = (kJoinShare - kSheetShare) / static_cast<double>(formats_.size());
      const double low = kSheetShare + share * static_cast<double>(f);
      const std::string folder = absl::StrCat(work_, "/join/", std::string(format.name));
      TESSERA_RETURN_IF_ERROR(EnsureFolder(folder));
      TESSERA_ASSIGN_OR_RETURN(const std::vector<std::string> names,
                               format.join(input, folder, PartOf(control_, low, low + share)));
      TESSERA_RETURN_IF_ERROR(MoveFiles(names, folder, absl::StrCat(files_, "/", std::string(format.name))));
    }
    return absl::OkStatus();
  }

  StatusOr<std::vector<ExportedFormat>> WriteIndex() {
    control_.Report(kJoinShare, "hashing");
    TESSERA_ASSIGN_OR_RETURN(const std::vector<std::string> names, ListFiles(files_));
    std::vector<ExportedFormat> exported;
    for (const ExportFormat* format : formats_) exported.push_back({std::string(format->name)});
    IndexJson files = IndexJson::array();
    for (const std::string& name : names) {
      TESSERA_RETURN_IF_ERROR(control_.Check());
      TESSERA_ASSIGN_OR_RETURN(const Digest digest, HashFile(absl::StrCat(files_, "/", name)));
      files.push_back({{"file", name}, {"bytes", digest.size_bytes}, {"sha256", digest.sha256}});
      for (ExportedFormat& format : exported) {
        if (name.rfind(format.name + "/", 0) != 0) continue;
        ++format.files;
        format.bytes += digest.size_bytes;
      }
    }
    IndexJson sheets = IndexJson::array();
    for (size_t i = 0; i < sheets_.size(); ++i) {
      const auto corner = [](const Eigen::Vector3d& p) { return IndexJson{p.x(), p.y(), p.z()}; };
      sheets.push_back({{"sheet", SheetName(sheets_[i].id)},
                        {"box_min", corner(boxes_[i].min())},
                        {"box_max", corner(boxes_[i].max())},
                        {"faces", sheets_[i].faces},
                        {"set_aside", IsSetAside(result_, sheets_[i].id)}});
    }
    const IndexJson index = {{"tessera_export", 1},
                             {"formats", options_.formats},
                             {"options", IndexJson::parse(ExportOptionsToJson(options_))},
                             {"crs", crs_},
                             {"sheets", std::move(sheets)},
                             {"files", std::move(files)},
                             {"warnings", warnings_},
                             {"left_out", left_out_}};
    TESSERA_RETURN_IF_ERROR(WriteFileAtomic(absl::StrCat(files_, "/", kExportIndexFile),
                                            index.dump(1, ' ', false, IndexJson::error_handler_t::replace) + "\n"));
    return exported;
  }

  // Calls `work` for all sheets in parallel, with progress by their faces.
  Status ForEach(double low, double high, const std::string& stage, const std::function<Status(size_t)>& work) {
    int64_t all = 0;
    for (const SheetEntry& sheet : sheets_) all += sheet.faces;
    std::atomic<int64_t> done = 0;
    std::atomic<size_t> sheets_done = 0;
    control_.Report(low, stage);
    return ForEachSheet(sheets_.size(), workers_, [&](size_t i) -> Status {
      TESSERA_RETURN_IF_ERROR(control_.Check());
      TESSERA_RETURN_IF_ERROR(work(i));
      const double share = static_cast<double>(done += sheets_[i].faces) / static_cast<double>(all);
      control_.Report(low + (high - low) * share,
                      absl::StrCat(stage, ", sheet ", ++sheets_done, " of ", sheets_.size()));
      return absl::OkStatus();
    });
  }

  // Sheets report no progress of their own.
  TaskControl Quiet() const {
    TaskControl quiet;
    quiet.cancelled = control_.cancelled;
    return quiet;
  }

  std::string WorkFolder(const ExportFormat& format, const SheetId& id) const {
    return absl::StrCat(work_, "/", std::string(format.name), "/", SheetName(id));
  }

  StatusOr<SheetInput> InputOf(size_t i, bool neighbours, bool photographs) const {
    const SheetId id = sheets_[i].id;
    SheetInput input{result_.scene, options_, id, {}, {}, {}, {}, {}, {}, IsSetAside(result_, id)};
    TESSERA_ASSIGN_OR_RETURN(input.sheet, ReadSheet(SheetPath(result_sheets_, id)));
    for (const SheetEntry& other : sheets_) {
      if (!neighbours || other.id == id) continue;
      if (std::abs(other.id.x - id.x) > 1 || std::abs(other.id.y - id.y) > 1) continue;
      TESSERA_ASSIGN_OR_RETURN(Sheet sheet, ReadSheet(SheetPath(result_sheets_, other.id)));
      input.neighbours.push_back(std::move(sheet));
    }
    if (std::find(start_ids_.begin(), start_ids_.end(), id) != start_ids_.end()) {
      TESSERA_ASSIGN_OR_RETURN(input.start, ReadSheet(SheetPath(start_sheets_, id)));
    }
    if (photographs && result_.described) {
      const SceneDescription& scene = *result_.described;
      for (const int32_t v : ViewsOf(sheets_[i])) {
        const SceneView& view = scene.views[v];
        input.views.push_back(view);
        input.view_files.push_back(absl::StrCat(scene.folder, "/", view.image_path));
        input.mask_files.push_back(view.mask_path.empty() ? "" : absl::StrCat(scene.folder, "/", view.mask_path));
      }
    }
    return input;
  }

  // Indices of the scene's views that may show the sheet: those that the job chose, if the result has them.
  std::vector<int32_t> ViewsOf(const SheetEntry& sheet) const {
    const std::vector<SceneView>& views = result_.described->views;
    const auto chosen = result_.views_of_sheets.find(sheet.id);
    if (chosen == result_.views_of_sheets.end()) return ViewsOfBox(views, sheet.box);
    const std::set<std::string> names(chosen->second.begin(), chosen->second.end());
    std::vector<int32_t> found;
    for (size_t v = 0; v < views.size(); ++v) {
      if (names.contains(views[v].name)) found.push_back(static_cast<int32_t>(v));
    }
    return found;
  }

  const ExportRequest& request_;
  const ExportOptions& options_;
  const std::span<const ExportFormat> table_;
  Warnings& warnings_;
  const TaskControl& control_;

  std::vector<const ExportFormat*> formats_;
  bool needs_sheets_ = false, needs_neighbours_ = false, needs_photographs_ = false, needs_colors_ = false;
  bool wants_start_ = false, is_colored_ = false;
  ResultFolder result_;
  std::string start_path_;  // empty: no start mesh
  std::vector<std::string> left_out_;
  // In the staging folder: sheets of the result and of the start; sheets that a step writes; files to deliver, a folder
  // a format; all else.
  std::string result_sheets_, start_sheets_, step_sheets_, files_, work_;
  std::vector<SheetEntry> sheets_;          // by y, then x
  std::vector<Eigen::AlignedBox3d> boxes_;  // of sheets_, in the system of the export
  std::vector<SheetId> start_ids_;
  std::string crs_;
  int workers_ = 1;
};

}  // namespace

StatusOr<std::vector<ExportedFormat>> ExportFolder(const ExportRequest& request, Warnings* warnings,
                                                   const TaskControl& control, std::span<const ExportFormat> formats) {
  return FolderExport(request, formats, warnings, control).Run();
}

}  // namespace tessera
