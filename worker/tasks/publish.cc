#include <algorithm>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "common/meshio/ply.h"
#include "common/storage/files.h"
#include "common/storage/mapped_file.h"
#include "worker/publish/fit_summary.h"
#include "worker/publish/flipped_faces.h"
#include "worker/publish/job_summary.h"
#include "worker/publish/merge_cores.h"
#include "worker/publish/outdated_faces.h"
#include "worker/publish/tile_meshes.h"
#include "worker/tasks/task_functions.h"

namespace tessera {

StatusOr<TaskOutcome> RunPublish(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const PublishParameters parameters, ParsePublishParameters(request.parameters));
  control.Report(0, "reading the city");
  TESSERA_ASSIGN_OR_RETURN(const std::string survey_json, ReadFile(InputPath(request, kPlainSurveyFile)));
  TESSERA_ASSIGN_OR_RETURN(Survey survey, ParseSurvey(survey_json));
  survey.scene_name = parameters.scene_name;
  survey.warnings = parameters.warnings;
  survey.fit = parameters.fit;
  survey.source = parameters.source;
  survey.skipped_images = parameters.skipped_images;
  for (const int tile : parameters.quarantined) {
    survey.warnings.push_back(absl::StrCat("tile ", tile,
                                           " is quarantined: its refinement failed; it is published as it was before "
                                           "the failed level, or as in the input"));
  }
  TESSERA_ASSIGN_OR_RETURN(const CityReader city, CityReader::Open(InputPath(request, kCityFile)));

  std::vector<MappedState> cores;
  std::vector<CoreSpans> spans;
  std::vector<ReportedTile> reported;
  std::vector<TileParameters> tiles;
  for (const TileParameters& tile : parameters.tiles) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    if (tile.core.empty()) continue;  // the tile no longer exists
    tiles.push_back(tile);
    TESSERA_ASSIGN_OR_RETURN(MappedState core,
                             MappedState::Open(InputPath(request, TileInputName(tile.tile, kStateFile))));
    spans.emplace_back(core.spans());
    const bool quarantined =
        std::binary_search(parameters.quarantined.begin(), parameters.quarantined.end(), tile.tile);
    reported.push_back({core.spans().tile, core.spans().report, quarantined});
    cores.push_back(std::move(core));
    control.Report(0.1 * static_cast<double>(tiles.size()) / parameters.tiles.size(), "reading cores");
  }
  ScratchArray<FlippedFace> flipped;
  if (parameters.flip_edges) {
    TESSERA_ASSIGN_OR_RETURN(flipped, FlipCores(city, survey.ground, tiles, parameters.quarantined, request.output_dir,
                                                PartOf(control, 0.1, 0.2), &spans));
  }
  TESSERA_ASSIGN_OR_RETURN(const CoreMerger merger, CoreMerger::Create(city, spans));
  OutdatedFaces outdated;
  if (parameters.outdated) {
    TESSERA_ASSIGN_OR_RETURN(outdated, OutdatedFaces::Open(InputPath(request, kOutdatedFile)));
  }

  control.Report(0.2, "writing the mesh");
  PlyLayout layout;
  layout.vertices = city.vertices();
  layout.faces = city.faces();
  layout.has_labels = layout.has_confidence = layout.has_input_face = true;
  layout.has_outdated = !outdated.ids().empty();
  for (const SceneClass& c : survey.classes) layout.label_colors_rgb.push_back(c.color_rgb);
  TESSERA_ASSIGN_OR_RETURN(PlyStream mesh, PlyStream::Create(OutputPath(request, kMeshFile), layout));
  TESSERA_ASSIGN_OR_RETURN(ResultStatistics statistics,
                           ResultStatistics::Create(request.output_dir, survey.classes.size()));
  TESSERA_ASSIGN_OR_RETURN(auto positions, ScratchList<Eigen::Vector3d>::Create(request.output_dir));
  const Eigen::Matrix3d scene_from_local = survey.rotation_local_from_scene.transpose();
  IdIndex places;
  TESSERA_RETURN_IF_ERROR(merger.ForEachVertex([&](const MergedVertex& vertex) {
    places.Add(vertex.id);
    mesh.AddVertex(scene_from_local * vertex.after + survey.origin_in_scene);
    statistics.AddVertex(vertex.before, vertex.after);
    positions.Append(vertex.after);
  }));
  TESSERA_ASSIGN_OR_RETURN(const auto after, positions.Finish());
  TESSERA_RETURN_IF_ERROR(control.Check());
  control.Report(0.5, "writing the mesh");
  MeshSpans one_face;
  one_face.vertices = after.values();
  std::span<const uint32_t> outdated_left = outdated.ids();
  TESSERA_RETURN_IF_ERROR(merger.ForEachFace([&](const MergedFace& face) {
    while (!outdated_left.empty() && outdated_left.front() < face.id) outdated_left = outdated_left.subspan(1);
    const bool is_outdated = !outdated_left.empty() && outdated_left.front() == face.id;
    const Triangle corners = {places(face.vertices[0]), places(face.vertices[1]), places(face.vertices[2])};
    mesh.AddFace({corners, face.label, face.confidence, face.input_face, is_outdated});
    one_face.faces = {&corners, 1};
    statistics.AddFace(face.area_before_m2, face.label_before, FaceArea(one_face, 0), face.label);
  }));
  TESSERA_RETURN_IF_ERROR(mesh.Finish());
  for (size_t v = 0; v < std::min(parameters.view_names.size(), survey.views.size()); ++v) {
    survey.views[v].name = parameters.view_names[v];
  }
  TaskOutcome outcome;
  outcome.warnings = FitWarnings(FitsOf(reported), survey);
  survey.warnings.insert(survey.warnings.end(), outcome.warnings.begin(), outcome.warnings.end());
  TESSERA_ASSIGN_OR_RETURN(const std::string report, MakeReport(survey, std::move(statistics), reported));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(OutputPath(request, kReportFile), report));

  outcome.outputs = {kMeshFile, kReportFile};
  if (parameters.tiles.size() > 1) {
    TESSERA_ASSIGN_OR_RETURN(const std::vector<std::string> names,
                             WriteTileMeshes(request.output_dir, city, survey, tiles, spans, outdated.ids(),
                                             parameters.quarantined, PartOf(control, 0.8, 1)));
    outcome.outputs.insert(outcome.outputs.end(), names.begin(), names.end());
  }
  outcome.stats = nlohmann::json{{"faces", city.faces()}, {"seconds", SecondsSince(clock, start_us)}}.dump();
  return outcome;
}

}  // namespace tessera
