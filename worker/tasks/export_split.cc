// The stage split of an export.
#include <algorithm>
#include <span>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/exporting/sheet_splitter.h"
#include "common/exporting/survey_sheets.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "common/meshio/ply.h"
#include "common/storage/files.h"
#include "worker/city/city_file.h"
#include "worker/city/id_merge.h"
#include "worker/publish/merge_cores.h"
#include "worker/tasks/export_sheets.h"
#include "worker/tasks/task_functions.h"

namespace tessera {
namespace {

constexpr double kSplitReadShare = 0.4;  // of the time: reading the result
constexpr int64_t kElementsPerReport = 1 << 16;

struct CityBlocks {
  std::vector<CityBlock> blocks;

  static StatusOr<CityBlocks> Of(const CityReader& city) {
    CityBlocks all;
    for (size_t b = 0; b < city.block_count(); ++b) {
      TESSERA_ASSIGN_OR_RETURN(all.blocks.emplace_back(), city.Block(b));
    }
    return all;
  }
  IdMerge<uint32_t> Merge(std::span<const uint32_t> CityBlock::*ids) const {
    std::vector<std::span<const uint32_t>> lists;
    for (const CityBlock& block : blocks) lists.push_back(block.*ids);
    return IdMerge<uint32_t>(std::move(lists));
  }
};

// The start position of each vertex of a city, in the order of ids, which is that of the published mesh.
class StartPositions {
 public:
  explicit StartPositions(const CityBlocks& city) : city_(city), merge_(city.Merge(&CityBlock::vertex_ids)) {}
  bool AtEnd() const { return merge_.AtEnd(); }
  uint32_t id() const { return merge_.key(); }
  const Eigen::Vector3d& position() const { return city_.blocks[merge_.list()].mesh.vertices[merge_.index()]; }
  // To the next vertex; a vertex may be in several blocks.
  void Advance() {
    const uint32_t id = merge_.key();
    while (!merge_.AtEnd() && merge_.key() == id) merge_.Advance();
  }

 private:
  const CityBlocks& city_;
  IdMerge<uint32_t> merge_;
};

// Gives the published mesh to a splitter, in the local frame and with displacements.
class ResultSink final : public MeshSink {
 public:
  ResultSink(SheetSplitter& splitter, const ExportScene& scene, const CityBlocks& city, int64_t elements,
             const TaskControl& control)
      : splitter_(splitter), scene_(scene), start_(city), elements_(elements), control_(control) {}

  Status Begin(const MeshLayout& layout) override {
    if (layout.labels == MeshLabels::kOfFaces && layout.has_confidence) return absl::OkStatus();
    return absl::DataLossError(absl::StrCat(kMeshFile, ": found no labels or no confidence of faces"));
  }
  void AddVertex(const Eigen::Vector3d& position, int32_t /*label*/) override {
    Count();
    too_many_ |= start_.AtEnd();
    if (too_many_) return;
    const Eigen::Vector3d local = scene_.frame.LocalFromScene(position);
    splitter_.AddVertex(local, static_cast<float>((local - start_.position()).norm()));
    start_.Advance();
  }
  void SetConfidence(float confidence) override { confidence_ = confidence; }
  void AddFace(const Triangle& face, int32_t label) override {
    Count();
    bad_label_ |= label < -1 || label >= static_cast<int32_t>(scene_.classes.size());
    splitter_.AddFace(face, label, confidence_);
  }
  // DATA_LOSS if the mesh is not that of the city.
  Status Finish() const {
    if (too_many_ || !start_.AtEnd()) {
      return absl::DataLossError(
          absl::StrCat(kMeshFile, ": found ", too_many_ ? "more" : "fewer", " vertices than ", kCityFile, " has"));
    }
    if (bad_label_) return absl::DataLossError(absl::StrCat(kMeshFile, ": found a label that is no class"));
    return absl::OkStatus();
  }

 private:
  void Count() {
    if (++count_ % kElementsPerReport != 0) return;
    control_.Report(kSplitReadShare * static_cast<double>(count_) / static_cast<double>(elements_ + 1),
                    "reading the mesh");
  }

  SheetSplitter& splitter_;
  const ExportScene& scene_;
  StartPositions start_;
  const int64_t elements_;
  const TaskControl& control_;
  float confidence_ = 0;
  bool too_many_ = false, bad_label_ = false;
  int64_t count_ = 0;
};

Status AddStart(const CityBlocks& city, SheetSplitter* splitter) {
  IdIndex places;
  for (StartPositions start(city); !start.AtEnd(); start.Advance()) {
    places.Add(start.id());
    splitter->AddVertex(start.position());
  }
  for (IdMerge<uint32_t> faces = city.Merge(&CityBlock::face_ids); !faces.AtEnd(); faces.Advance()) {
    const CityBlock& block = city.blocks[faces.list()];
    const Triangle ids = block.GlobalFace(faces.index());
    splitter->AddFace({places(ids[0]), places(ids[1]), places(ids[2])}, block.mesh.labels[faces.index()]);
  }
  return absl::OkStatus();
}

// Writes the sheets, and empty ones for those of the survey that have no faces.
StatusOr<std::vector<SheetId>> FinishSheets(SheetSplitter splitter, const TaskRequest& request,
                                            const std::vector<SheetId>& sheets, std::string (*name)(const SheetId&),
                                            const TaskControl& control, TaskOutcome* outcome) {
  const std::string first = OutputPath(request, name(sheets.front()));
  const std::string folder = first.substr(0, first.rfind('/'));
  TESSERA_RETURN_IF_ERROR(EnsureFolder(folder));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<SheetEntry> entries, splitter.Finish(folder, control));
  std::vector<SheetId> with_faces;
  for (const SheetEntry& entry : entries) with_faces.push_back(entry.id);
  for (const SheetId& id : sheets) {
    outcome->outputs.push_back(name(id));
    if (std::find(with_faces.begin(), with_faces.end(), id) != with_faces.end()) continue;
    TESSERA_RETURN_IF_ERROR(WriteSheet(OutputPath(request, name(id)), Sheet()));
  }
  return with_faces;
}

}  // namespace

StatusOr<TaskOutcome> SplitResult(const TaskRequest& request, const ExportParameters& parameters,
                                  const TaskControl& control) {
  TESSERA_ASSIGN_OR_RETURN(const ExportScene scene, ParseExportScene(parameters.scene));
  TaskOutcome outcome;
  outcome.outputs = {kExportSceneFile, kSheetListFile};
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(OutputPath(request, kExportSceneFile), parameters.scene));
  if (parameters.sheets.empty()) {  // no format reads sheets
    TESSERA_RETURN_IF_ERROR(WriteFileAtomic(OutputPath(request, kSheetListFile), SheetListToJson({})));
    return outcome;
  }
  TESSERA_ASSIGN_OR_RETURN(const CityReader city, CityReader::Open(InputPath(request, kCityFile)));
  TESSERA_ASSIGN_OR_RETURN(const CityBlocks blocks, CityBlocks::Of(city));
  SplitOptions options;
  options.ground = scene.ground;
  options.allowed = parameters.sheets;
  if (parameters.start) {
    TESSERA_ASSIGN_OR_RETURN(SheetSplitter splitter, SheetSplitter::Create(request.output_dir, options));
    TESSERA_RETURN_IF_ERROR(AddStart(blocks, &splitter));
    TESSERA_RETURN_IF_ERROR(FinishSheets(std::move(splitter), request, parameters.sheets, StartSheetFileName,
                                         PartOf(control, 0, 0.4), &outcome)
                                .status());
  }
  const TaskControl rest = PartOf(control, parameters.start ? 0.4 : 0, 1);
  options.has_confidence = options.has_displacement = true;
  TESSERA_ASSIGN_OR_RETURN(SheetSplitter splitter, SheetSplitter::Create(request.output_dir, options));
  ResultSink sink(splitter, scene, blocks, city.vertices() + city.faces(), rest);
  MeshReadOptions read;
  read.confidence = true;
  TESSERA_RETURN_IF_ERROR(StreamPly(InputPath(request, kMeshFile), read, &sink));
  TESSERA_RETURN_IF_ERROR(sink.Finish());
  TESSERA_ASSIGN_OR_RETURN(const std::vector<SheetId> with_faces,
                           FinishSheets(std::move(splitter), request, parameters.sheets, SheetFileName,
                                        PartOf(rest, kSplitReadShare, 1), &outcome));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(OutputPath(request, kSheetListFile), SheetListToJson(with_faces)));
  if (!parameters.views) return outcome;
  TESSERA_ASSIGN_OR_RETURN(const std::string survey_json, ReadFile(InputPath(request, kPlainSurveyFile)));
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(survey_json));
  for (const SurveySheet& sheet : SheetsOf(survey)) {
    outcome.outputs.push_back(SheetViewsFileName(sheet.id));
    const std::string path = OutputPath(request, outcome.outputs.back());
    TESSERA_RETURN_IF_ERROR(EnsureFolder(path.substr(0, path.rfind('/'))));
    TESSERA_RETURN_IF_ERROR(WriteFileAtomic(path, SheetViewsToJson(survey, sheet)));
  }
  return outcome;
}

}  // namespace tessera
