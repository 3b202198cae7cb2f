#include "server/tiling/rough_quote.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "server/tiling/scene_survey.h"

namespace tessera {
namespace {

// Sampled faces in a square of the ground that is taken as covered, on average.
constexpr double kFacesOfSquare = 96;
// Bound of cells times views: each cell is projected into each view.
constexpr double kMostProjections = 2e8;
// Faces before the second split for each face after it: .42 to .58 on the scenes of tests/bench.
constexpr double kCoarseFaces = 0.47;

using Square = std::pair<int, int>;

// The sampled faces by square of the ground, by x, then y. The side is a multiple of the cells' side.
std::map<Square, std::vector<size_t>> SquaresOf(const TriangleMesh& mesh, const GroundPlane& ground,
                                                int* cells_of_side) {
  const MeshSpans faces(mesh);
  std::map<Square, size_t> cells;
  const auto cell_of = [&](size_t f) { return ground.Cell(faces.Centroid(f)); };
  for (size_t f = 0; f < mesh.faces.size(); ++f) ++cells[{cell_of(f).x(), cell_of(f).y()}];
  const double of_cell = static_cast<double>(mesh.faces.size()) / static_cast<double>(cells.size());
  const int side = std::max(1, static_cast<int>(std::ceil(std::sqrt(kFacesOfSquare / of_cell))));
  std::map<Square, std::vector<size_t>> squares;
  const auto square = [side](int cell) { return static_cast<int>(std::floor(static_cast<double>(cell) / side)); };
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    squares[{square(cell_of(f).x()), square(cell_of(f).y())}].push_back(f);
  }
  *cells_of_side = side;
  return squares;
}

// Adds a copy of the face, moved along the ground so that its centroid is at `to`.
void AddMoved(const TriangleMesh& mesh, size_t face, const GroundPlane& ground, const Eigen::Vector2d& to,
              TriangleMesh* moved) {
  const Eigen::Vector2d by = to - ground.Coordinates(MeshSpans(mesh).Centroid(face));
  const Eigen::Vector3d shift = ground.axis_x * by.x() + ground.axis_y * by.y();
  const auto next = static_cast<uint32_t>(moved->vertices.size());
  for (int k = 0; k < 3; ++k) moved->vertices.push_back(mesh.Corner(face, k) + shift);
  moved->faces.push_back({next, next + 1, next + 2});
}

// A mesh with one face in each ground cell, until `most` cells are made. `share`: part of the area that they are.
TriangleMesh OneFaceOfEachCell(const TriangleMesh& mesh, const GroundPlane& ground, size_t most, double* share) {
  int side = 1;
  const auto squares = SquaresOf(mesh, ground, &side);
  const auto cells = static_cast<double>(squares.size()) * side * side;
  TriangleMesh out;
  size_t seen = 0;
  for (const auto& [at, faces] : squares) {
    if (seen > 0 && out.faces.size() + static_cast<size_t>(side) * side > most) break;
    seen += 1;
    size_t next = 0;
    // A square with few faces is at the border: it is covered in part.
    const double filled = std::min(1.0, static_cast<double>(faces.size()) / (0.5 * kFacesOfSquare));
    const int rows = std::max(1, static_cast<int>(std::lround(filled * side)));
    for (int y = 0; y < rows; ++y) {
      for (int x = 0; x < side; ++x) {
        const Eigen::Vector2d centre((at.first * side + x + 0.5) * ground.cell_m,
                                     (at.second * side + y + 0.5) * ground.cell_m);
        AddMoved(mesh, faces[next++ % faces.size()], ground, centre, &out);
      }
    }
  }
  *share = static_cast<double>(seen) * side * side / cells;
  return out;
}

// Makes the faces of the survey those after the second split.
void SplitTwice(Survey* survey) {
  survey->faces = 0;
  for (SurveyCell& cell : survey->cells) {
    cell.fine_faces = cell.faces;
    cell.faces = std::max<int64_t>(1, std::llround(kCoarseFaces * static_cast<double>(cell.faces)));
    survey->faces += cell.faces;
  }
}

Interval Around(double low, double high) { return {kRoughLow * low, kRoughHigh * high}; }

}  // namespace

StatusOr<Survey> SurveyOfSample(const SceneDescription& scene, const MeshSample& sample, bool classifies,
                                size_t most_cells, double* share) {
  TESSERA_ASSIGN_OR_RETURN(const double gsd_m, MedianGsd(scene, sample.mesh));
  const GroundPlane ground = MakeGroundPlane(scene.up_in_local, CellSide_m(gsd_m));
  const auto most =
      static_cast<size_t>(std::clamp(kMostProjections / static_cast<double>(std::max<size_t>(1, scene.views.size())),
                                     1.0, static_cast<double>(most_cells)));
  const TriangleMesh cells = OneFaceOfEachCell(sample.mesh, ground, most, share);
  Survey survey = EstimateSurvey(scene, cells, gsd_m);
  const double weight = static_cast<double>(sample.faces) * *share / static_cast<double>(cells.faces.size());
  survey.faces = 0;
  for (SurveyCell& cell : survey.cells) {
    cell.faces = std::max<int64_t>(1, std::llround(weight * static_cast<double>(cell.faces)));
    survey.faces += cell.faces;
  }
  survey.input_faces = static_cast<int64_t>(static_cast<double>(sample.faces) * *share);
  survey.input_vertices = survey.input_faces / 2;
  survey.vertices = survey.faces / 2;
  if (classifies) {
    survey.classifier = "to be classified";
    survey.has_likelihoods = true;
  }
  FillViewDepths(&survey);
  return survey;
}

StatusOr<RoughQuote> MakeRoughQuote(const JobSettings& settings, const SceneDescription& scene,
                                    const MeshSample& sample, size_t most_cells) {
  RoughQuote rough;
  TESSERA_ASSIGN_OR_RETURN(Survey survey,
                           SurveyOfSample(scene, sample, Classifies(settings), most_cells, &rough.share));
  if (FirstFineStepOf(settings) > 0) SplitTwice(&survey);
  // A share of the city has that share of the requested tiles.
  JobSettings of_share = settings;
  if (settings.tiles > 1) of_share.tiles = std::max(1, static_cast<int>(std::lround(rough.share * settings.tiles)));
  TESSERA_ASSIGN_OR_RETURN(const Quote quote, MakeQuote(of_share, survey));
  const auto whole = [&](double of_tiles, double of_job) { return of_job + (of_tiles - of_job) / rough.share; };
  const double tiles = static_cast<double>(quote.tiles.size()) / rough.share;
  const double core_s = whole(quote.core_seconds, quote.ingest.core_seconds);
  const double stored = static_cast<double>(quote.stored_bytes) / rough.share;
  const auto peak = static_cast<double>(quote.peak_bytes);
  rough.gsd_m = survey.gsd_m;
  rough.core_seconds = Around(quote.interval.low * core_s, quote.interval.high * core_s);
  rough.peak_bytes = Around(kRefineBytesInterval.low * peak, kRefineBytesInterval.high * peak);
  rough.stored_bytes = Around(kStoredBytesInterval.low * stored, kStoredBytesInterval.high * stored);
  rough.area_m2 = Around(quote.area_m2 / rough.share, quote.area_m2 / rough.share);
  rough.tiles = {std::max(1.0, std::floor(kRoughLow * tiles)), std::ceil(kRoughHigh * tiles)};
  if (settings.tiles > 0 && settings.tile_memory_bytes == 0) {
    rough.tiles = {static_cast<double>(settings.tiles), static_cast<double>(settings.tiles)};
  }
  return rough;
}

}  // namespace tessera
