// The second split of faces, and the states with which tiles start.
#include <algorithm>
#include <array>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>
#include <set>
#include <span>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "common/storage/files.h"
#include "worker/city/city_file.h"
#include "worker/city/collected_faces.h"
#include "worker/city/disk_mesh.h"
#include "worker/city/moved_city.h"
#include "worker/publish/merge_cores.h"
#include "worker/refine/density.h"
#include "worker/tasks/task_functions.h"
#include "worker/tile/repair_tile.h"
#include "worker/tile/tile_files.h"

namespace tessera {
namespace {

// The city before the second split: where the coarse levels moved it, and per face what it has in the city and in the
// states.
struct CoarseCity {
  DiskMesh mesh;  // without labels
  ScratchArray<uint32_t> input_face;
  ScratchArray<int32_t> labels_before, labels;
  ScratchArray<float> confidence;
};

StatusOr<CoarseCity> MergeStates(const CityReader& city, const std::vector<CoreSpans>& cores,
                                 const std::string& scratch) {
  CoarseCity out;
  TESSERA_ASSIGN_OR_RETURN(const CoreMerger merger, CoreMerger::Create(city, cores));
  const auto vertices = static_cast<size_t>(city.vertices()), faces = static_cast<size_t>(city.faces());
  TESSERA_ASSIGN_OR_RETURN(out.mesh.vertices, ScratchArray<Eigen::Vector3d>::Create(scratch, vertices));
  TESSERA_ASSIGN_OR_RETURN(out.mesh.starts, ScratchArray<Eigen::Vector3d>::Create(scratch, vertices));
  TESSERA_ASSIGN_OR_RETURN(out.mesh.faces, ScratchArray<Triangle>::Create(scratch, faces));
  TESSERA_ASSIGN_OR_RETURN(out.input_face, ScratchArray<uint32_t>::Create(scratch, faces));
  TESSERA_ASSIGN_OR_RETURN(out.labels_before, ScratchArray<int32_t>::Create(scratch, faces));
  TESSERA_ASSIGN_OR_RETURN(out.labels, ScratchArray<int32_t>::Create(scratch, faces));
  TESSERA_ASSIGN_OR_RETURN(out.confidence, ScratchArray<float>::Create(scratch, faces));
  IdIndex places;
  size_t v = 0, f = 0;
  TESSERA_RETURN_IF_ERROR(merger.ForEachVertex([&](const MergedVertex& vertex) {
    places.Add(vertex.id);
    if (v >= vertices) return;  // ForEachVertex reports the wrong count
    out.mesh.starts[v] = vertex.before;
    out.mesh.vertices[v++] = vertex.after;
  }));
  TESSERA_RETURN_IF_ERROR(merger.ForEachFace([&](const MergedFace& face) {
    if (f >= faces) return;
    out.mesh.faces[f] = {places(face.vertices[0]), places(face.vertices[1]), places(face.vertices[2])};
    out.input_face[f] = face.input_face;
    out.labels_before[f] = face.label_before;
    out.labels[f] = face.label;
    out.confidence[f++] = face.confidence;
  }));
  return out;
}

template <class Value>
StatusOr<ScratchArray<Value>> OfParents(const ScratchArray<Value>& values, const ScratchArray<uint32_t>& parents,
                                        const std::string& scratch) {
  TESSERA_ASSIGN_OR_RETURN(auto out, ScratchArray<Value>::Create(scratch, parents.size()));
  for (size_t f = 0; f < parents.size(); ++f) out[f] = values[parents[f]];
  return out;
}

using CellPlace = std::array<int, 2>;  // x, y

bool PrecedesInSurvey(const SurveyCell& cell, const CellPlace& at) {
  return cell.y != at[1] ? cell.y < at[1] : cell.x < at[0];
}

CellPlace PlaceOf(const MeshSpans& mesh, size_t face, const GroundPlane& ground) {
  const Eigen::Vector2i cell = ground.Cell(mesh.Centroid(face));
  return {cell.x(), cell.y()};
}

// The cells of `mesh`. A cell keeps its views; one that had no faces gets those of the cells of its faces' parents.
// `before`: per face of `mesh`, the cell of its parent.
StatusOr<std::vector<SurveyCell>> CellsAfter(const MeshSpans& mesh, const ScratchArray<CellPlace>& before,
                                             const Survey& survey) {
  std::map<CellPlace, std::vector<int32_t>> views;
  for (const SurveyCell& cell : survey.cells) views[{cell.x, cell.y}] = cell.views;
  std::map<CellPlace, std::set<int32_t>> of_new;
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const CellPlace at = PlaceOf(mesh, f, survey.ground);
    if (at == before[f] || views.contains(at)) continue;
    const auto of_parent = views.find(before[f]);
    if (of_parent == views.end()) {
      return absl::DataLossError(absl::StrCat("city: found a face in the cell at (", before[f][0], ", ", before[f][1],
                                              "), which the survey does not have"));
    }
    of_new[at].insert(of_parent->second.begin(), of_parent->second.end());
  }
  std::vector<SurveyCell> cells = CellsOf(mesh, survey.ground);
  for (SurveyCell& cell : cells) {
    const CellPlace at = {cell.x, cell.y};
    const auto found = of_new.find(at);
    cell.views = found == of_new.end() ? views[at] : std::vector<int32_t>(found->second.begin(), found->second.end());
  }
  return cells;
}

// The boxes of the cells' faces where the coarse levels moved them. `unmoved`: the start, whose cells `cells` are.
StatusOr<std::vector<Eigen::AlignedBox3d>> MovedBoxes(const std::vector<SurveyCell>& cells, const MeshSpans& unmoved,
                                                      std::span<const Eigen::Vector3d> positions,
                                                      const GroundPlane& ground) {
  std::vector<Eigen::AlignedBox3d> boxes(cells.size());
  auto cell = cells.begin();
  for (size_t f = 0; f < unmoved.faces.size(); ++f) {
    const CellPlace at = PlaceOf(unmoved, f, ground);
    // Consecutive faces are mostly in the same cell.
    if (f == 0 || cell->x != at[0] || cell->y != at[1]) {
      cell = std::lower_bound(cells.begin(), cells.end(), at, PrecedesInSurvey);
      if (cell == cells.end() || cell->x != at[0] || cell->y != at[1]) {
        return absl::InternalError(
            absl::StrCat("found a face in the cell at (", at[0], ", ", at[1], "), which the survey does not have"));
      }
    }
    for (const uint32_t v : unmoved.faces[f]) boxes[static_cast<size_t>(cell - cells.begin())].extend(positions[v]);
  }
  return boxes;
}

}  // namespace

StatusOr<TaskOutcome> RunSplit(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const SplitParameters parameters, ParseSplitParameters(request.parameters));
  TESSERA_ASSIGN_OR_RETURN(const TempFolder scratch_folder, TempFolder::Create(request.output_dir, "scratch-"));
  const std::string& scratch = scratch_folder.path();
  control.Report(0, "reading the city");
  TESSERA_ASSIGN_OR_RETURN(const std::string survey_json, ReadFile(InputPath(request, kSurveyFile)));
  TESSERA_ASSIGN_OR_RETURN(Survey survey, ParseSurvey(survey_json));
  TESSERA_ASSIGN_OR_RETURN(const CityReader city, CityReader::Open(InputPath(request, kCityFile)));
  std::vector<MappedState> states;
  std::vector<CoreSpans> cores;
  MovedSpans moved;
  for (int tile = 0; tile < parameters.tiles; ++tile) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    TESSERA_ASSIGN_OR_RETURN(states.emplace_back(),
                             MappedState::Open(InputPath(request, TileInputName(tile, kStateFile))));
    cores.emplace_back(states.back().spans());
    moved.reports[tile] = states.back().spans().report;
  }
  TESSERA_ASSIGN_OR_RETURN(CoarseCity coarse, MergeStates(city, cores, scratch));
  control.Report(0.2, "splitting faces");
  TESSERA_ASSIGN_OR_RETURN(auto cell_of_face, ScratchArray<CellPlace>::Create(scratch, coarse.mesh.faces.size()));
  MeshSpans unmoved = coarse.mesh.spans();
  unmoved.vertices = coarse.mesh.starts.values();
  for (size_t f = 0; f < unmoved.faces.size(); ++f) cell_of_face[f] = PlaceOf(unmoved, f, survey.ground);
  std::vector<PosedCamera> cameras;
  for (const SceneView& view : survey.views) {
    if (!view.withdrawn) cameras.push_back(view.camera);
  }
  TESSERA_ASSIGN_OR_RETURN(DiskMesh mesh, SplitOnDisk(std::move(coarse.mesh), cameras, DensityOptions(), scratch,
                                                      DiskPassOptions(), [&](double fraction) {
                                                        control.Report(0.2 + 0.4 * fraction, "splitting faces");
                                                        return control.Check();
                                                      }));
  if (mesh.input_face.size() == 0) {  // no face was split
    TESSERA_ASSIGN_OR_RETURN(mesh.input_face, ScratchArray<uint32_t>::Create(scratch, mesh.faces.size()));
    std::iota(mesh.input_face.values().begin(), mesh.input_face.values().end(), 0u);
  }
  const ScratchArray<uint32_t> parents = std::move(mesh.input_face);
  TESSERA_ASSIGN_OR_RETURN(mesh.input_face, OfParents(coarse.input_face, parents, scratch));
  TESSERA_ASSIGN_OR_RETURN(mesh.labels, OfParents(coarse.labels_before, parents, scratch));
  TESSERA_ASSIGN_OR_RETURN(const auto labels, OfParents(coarse.labels, parents, scratch));
  TESSERA_ASSIGN_OR_RETURN(const auto confidence, OfParents(coarse.confidence, parents, scratch));
  TESSERA_ASSIGN_OR_RETURN(const auto cells_before, OfParents(cell_of_face, parents, scratch));

  control.Report(0.6, "writing the city");
  unmoved = mesh.spans();
  unmoved.vertices = mesh.starts.values();
  TESSERA_ASSIGN_OR_RETURN(survey.cells, CellsAfter(unmoved, cells_before, survey));
  survey.vertices = static_cast<int64_t>(mesh.vertices.size());
  survey.faces = static_cast<int64_t>(mesh.faces.size());
  FillViewDepths(&survey);
  TESSERA_RETURN_IF_ERROR(WriteCity(OutputPath(request, kCityFile), {unmoved, mesh.input_face.values()}, survey.ground,
                                    survey.cells, scratch));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<Eigen::AlignedBox3d> boxes,
                           MovedBoxes(survey.cells, unmoved, mesh.vertices.values(), survey.ground));
  moved.positions = mesh.vertices.values();
  moved.cell_boxes = boxes;
  moved.labels = labels.values();
  moved.confidence = confidence.values();
  TESSERA_RETURN_IF_ERROR(WriteMovedCity(OutputPath(request, kMovedFile), moved));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(OutputPath(request, kSurveyFile), SurveyToJson(survey)));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(OutputPath(request, kPlainSurveyFile), SurveyToJson(WithoutNames(survey))));
  TaskOutcome outcome;
  outcome.outputs = {kCityFile, kMovedFile, kSurveyFile, kPlainSurveyFile};
  outcome.stats = nlohmann::json{{"coarse_faces", coarse.labels.size()},
                                 {"faces", survey.faces},
                                 {"cells", survey.cells.size()},
                                 {"seconds", SecondsSince(clock, start_us)}}
                      .dump();
  return outcome;
}

StatusOr<TaskOutcome> RunStart(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const StartParameters parameters, ParseStartParameters(request.parameters));
  TESSERA_ASSIGN_OR_RETURN(const std::string survey_json, ReadFile(InputPath(request, kPlainSurveyFile)));
  TESSERA_ASSIGN_OR_RETURN(const Survey survey, ParseSurvey(survey_json));
  TESSERA_ASSIGN_OR_RETURN(const CityReader city, CityReader::Open(InputPath(request, kCityFile)));
  TESSERA_ASSIGN_OR_RETURN(CollectedFaces faces, CollectCells(city, survey.ground, parameters.tile.core, control));
  TileState state;
  state.tile = parameters.tile.tile;
  state.vertex_ids = std::move(faces.vertex_ids);
  state.positions = std::move(faces.mesh.vertices);
  state.face_ids = std::move(faces.face_ids);
  state.labels = std::move(faces.mesh.labels);
  const int classes = static_cast<int>(survey.classes.size());
  for (const int32_t label : state.labels) state.confidence.push_back(CarriedConfidence(classes, label));
  if (parameters.moved) {
    TESSERA_ASSIGN_OR_RETURN(const MovedCity moved,
                             MovedCity::Open(InputPath(request, kMovedFile), city.vertex_ids_end(), city.face_ids_end(),
                                             survey.cells.size()));
    const MovedSpans& spans = moved.spans();
    if ((!state.vertex_ids.empty() && state.vertex_ids.back() >= spans.positions.size()) ||
        (!state.face_ids.empty() && state.face_ids.back() >= spans.labels.size())) {
      return absl::DataLossError(std::string(kCityFile) + ": found ids beyond those of " + kMovedFile);
    }
    for (size_t v = 0; v < state.positions.size(); ++v) state.positions[v] = spans.positions[state.vertex_ids[v]];
    for (size_t f = 0; f < state.labels.size(); ++f) {
      state.labels[f] = spans.labels[state.face_ids[f]];
      state.confidence[f] = spans.confidence[state.face_ids[f]];
    }
    state.report = moved.ReportOf(state.tile);
  }
  TESSERA_RETURN_IF_ERROR(WriteTileState(OutputPath(request, kStateFile), state));
  TaskOutcome outcome;
  outcome.outputs = {kStateFile};
  outcome.stats = nlohmann::json{{"faces", state.face_ids.size()}, {"seconds", SecondsSince(clock, start_us)}}.dump();
  return outcome;
}

}  // namespace tessera
