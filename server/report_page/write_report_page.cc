#include "server/report_page/write_report_page.h"

#include <algorithm>
#include <filesystem>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/time.h"
#include "common/exporting/export_scene.h"
#include "common/job/task_parameters.h"
#include "common/scene/scene.h"
#include "common/storage/files.h"
#include "common/storage/mapped_file.h"
#include "server/display/update_text.h"
#include "server/report_page/job_command.h"
#include "server/report_page/report_facts.h"
#include "server/report_page/report_page.h"
#include "server/report_page/svg_plots.h"
#include "server/settings/job_settings.h"
#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

const v1::Artifact* FindArtifact(const v1::Job& job, const std::string& name) {
  for (const v1::Artifact& artifact : job.artifacts()) {
    if (artifact.name() == name) return &artifact;
  }
  return nullptr;
}

std::string TimeText(const google::protobuf::Timestamp& time) {
  if (time.seconds() <= 0) return "";
  return absl::FormatTime("%Y-%m-%d %H:%M UTC", absl::FromUnixSeconds(time.seconds()), absl::UTCTimeZone());
}

// The job's scene, if it can be read on this machine.
std::optional<SceneDescription> TryScene(const std::string& path) {
  std::error_code error;
  if (path.empty() || !fs::exists(path, error)) return std::nullopt;
  SceneLoadOptions options;
  options.skip_images = kMaxSkippedShare;  // no photograph is read
  options.needs_mesh = false;
  options.all_classes = true;
  Warnings ignored;
  StatusOr<SceneDescription> scene = LoadScene(path, &ignored, options);
  return scene.ok() ? std::optional(*std::move(scene)) : std::nullopt;
}

void SetColor(const std::string& name, const std::array<uint8_t, 3>& color_rgb, std::vector<ReportClass>* classes) {
  for (ReportClass& c : *classes) {
    if (c.name == name) c.color_rgb = color_rgb;
  }
}

PictureInputs PicturesOf(const ReportFacts& report, const std::optional<ExportScene>& place,
                         const std::optional<SceneDescription>& scene, const std::string& out) {
  PictureInputs inputs;
  inputs.mesh_path = absl::StrCat(out, "/", kMeshFile);
  inputs.scratch_folder = out;
  inputs.typical_displacement_m = report.p90_m.value_or(0);
  inputs.start_faces = static_cast<int64_t>(std::clamp(report.input_faces.value_or(0), 0.0, 1e15));
  for (const std::string& name : report.classes) inputs.classes.push_back({name, std::nullopt});
  if (scene) {
    inputs.frame = scene->frame;
    inputs.up = scene->up_in_local;
    for (const SceneClass& c : scene->classes) SetColor(c.name, c.color_rgb, &inputs.classes);
    if (!scene->mesh_path.empty()) {
      inputs.start_path = (fs::path(scene->folder) / scene->mesh_path).string();
      inputs.start_label_property = LabelPropertyOf(*scene, inputs.start_path);
    }
  }
  if (place) {
    inputs.frame = place->frame;
    inputs.up = place->up;
    for (const SceneClass& c : place->classes) SetColor(c.name, c.color_rgb, &inputs.classes);
  }
  return inputs;
}

// Where an imported scene comes from.
std::vector<std::pair<std::string, std::string>> SourceOf(const std::optional<ExportScene>& place,
                                                          const std::optional<SceneDescription>& scene) {
  const std::optional<SceneSource> source = place && place->source ? place->source
                                            : scene                ? scene->source
                                                                   : std::nullopt;
  if (!source) return {};
  std::vector<std::pair<std::string, std::string>> rows = {
      {"Coordinate system of the source", source->crs.empty() ? "local" : source->crs}};
  if (!source->offset.isZero()) {
    rows.emplace_back("Offset of the source",
                      absl::StrFormat("%.3f, %.3f, %.3f", source->offset.x(), source->offset.y(), source->offset.z()));
  }
  if (!source->tiles.empty())
    rows.emplace_back("Tiles of the source", PlotNumber(static_cast<double>(source->tiles.size())));
  return rows;
}

}  // namespace

StatusOr<std::string> WriteReportPage(const v1::Job& job, const std::string& out, const std::string& program_version,
                                      const TaskControl& control) {
  const std::string path = absl::StrCat(out, "/", kReportPageFile);
  TESSERA_RETURN_IF_ERROR(RemoveTree(path));  // it would describe another result
  if (FindArtifact(job, kReportFile) == nullptr) return std::string();
  ReportPageInputs page;
  TESSERA_ASSIGN_OR_RETURN(page.report_json, ReadFile(absl::StrCat(out, "/", kReportFile)));
  TESSERA_ASSIGN_OR_RETURN(const ReportFacts report, ParseReportFacts(page.report_json));
  MappedFile job_json;
  if (StatusOr<MappedFile> file = MappedFile::Open(out + "/job.json"); file.ok()) job_json = *std::move(file);
  page.job_json = {job_json.data(), job_json.size_bytes()};
  if (const auto update = ReadFile(absl::StrCat(out, "/", kUpdateFile)); update.ok()) {
    if (const auto summary = UpdateSummary(*update); summary.ok()) page.update_summary = *summary;
  }
  std::optional<ExportScene> place;
  if (!report.frame.empty()) {
    if (StatusOr<ExportScene> parsed = ParseExportScene(report.frame); parsed.ok()) place = *std::move(parsed);
  }
  const std::optional<SceneDescription> scene = TryScene(job.scene_path());
  StatusOr<ReportPictures> pictures = DrawReportPictures(PicturesOf(report, place, scene, out), control);
  TESSERA_RETURN_IF_ERROR(control.Check());
  if (pictures.ok()) {
    page.pictures = *std::move(pictures);
    if (page.pictures->start_shaded.empty() && page.pictures->no_start.empty()) {
      page.pictures->no_start = scene ? "The scene has no mesh of its own, so no start is shown."
                                      : "The start is not shown: the job's scene cannot be read on this machine.";
    }
  } else {
    page.no_pictures = absl::StrCat("The mesh cannot be drawn: ", std::string(pictures.status().message()));
  }
  page.scene_name = job.display_name();
  page.created = TimeText(job.create_time());
  page.finished = TimeText(job.end_time());
  if (const v1::Artifact* mesh = FindArtifact(job, kMeshFile)) page.mesh_sha256 = mesh->digest().sha256();
  page.program_version = program_version;
  page.command = RunCommandOf(job);
  page.source = SourceOf(place, scene);
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(path, MakeReportPage(page)));
  return path;
}

}  // namespace tessera
