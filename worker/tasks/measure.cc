#include <nlohmann/json.hpp>

#include "common/base/pick.h"
#include "common/job/refine_steps.h"
#include "common/job/task_parameters.h"
#include "worker/tasks/step_task.h"
#include "worker/tasks/task_functions.h"

namespace tessera {
namespace {

void FillDerivatives(const TileWorkspace& work, const FaceDerivatives& derivatives, TileSums* sums) {
  const PhotoSums& photo = derivatives.photo;
  sums->photo = Pick(photo.faces, work.core_faces());
  sums->sample.photo = Pick(photo.faces, work.sample_faces());
  if (photo.sums.weight > 0) sums->energy = photo.sums.energy / photo.sums.weight;
  if (photo.sums.semantic_pixels > 0) {
    sums->semantic_energy = photo.sums.semantic_energy / static_cast<double>(photo.sums.semantic_pixels);
  }
  sums->warped_pixels = photo.warped_pixels;
  std::vector<uint32_t> place(work.package().face_ids.size(), 0);
  for (uint32_t i = 0; i < work.core_faces().size(); ++i) place[work.core_faces()[i]] = i;
  const ContourSums& contours = derivatives.contours;
  for (FaceContour contour : contours.faces) {
    if (!(work.package().regions[contour.face] & kCoreRegion)) continue;  // the sample's are not compared
    contour.face = place[contour.face];
    const auto begin = static_cast<uint32_t>(sums->contours.views.size());
    sums->contours.views.insert(sums->contours.views.end(), contours.views.begin() + contour.views_begin,
                                contours.views.begin() + contour.views_end);
    contour.views_begin = begin;
    contour.views_end = static_cast<uint32_t>(sums->contours.views.size());
    sums->contours.faces.push_back(contour);
  }
}

void FillLikelihoods(const TileWorkspace& work, const FaceLikelihoods& likelihoods, TileSums* sums) {
  sums->classes = likelihoods.classes;
  const auto fill = [&](const std::vector<uint32_t>& faces, auto* out) {
    out->pixels = Pick(likelihoods.pixels, faces);
    for (const uint32_t f : faces) {
      const float* of_face = &likelihoods.sum[static_cast<size_t>(f) * likelihoods.classes];
      out->likelihoods.insert(out->likelihoods.end(), of_face, of_face + likelihoods.classes);
    }
  };
  fill(work.core_faces(), sums);
  fill(work.sample_faces(), &sums->sample);
}

}  // namespace

StatusOr<TaskOutcome> RunMeasure(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(StepTask task, OpenStepTask(request, 0, 0));
  TileWorkspace& work = *task.work;
  const TilePackage& package = work.package();
  TileSums sums;
  sums.tile = package.tile;
  sums.face_ids = Pick(package.face_ids, work.core_faces());
  sums.sample.face_ids = Pick(package.face_ids, work.sample_faces());
  nlohmann::json stats;
  TESSERA_ASSIGN_OR_RETURN(TileSight* const sight, work.Sight(InputPath(request, kViewsFile), task.options));
  double seconds_loading = SecondsSince(clock, start_us);
  if (task.step.labels()) {
    TESSERA_ASSIGN_OR_RETURN(const FaceLikelihoods likelihoods,
                             SumLikelihoods(package, work.measured(), task.snapshot.positions, sight->views,
                                            sight->data.groups, PartOf(control, 0, 0.9)));
    FillLikelihoods(work, likelihoods, &sums);
    stats["seconds_labels"] = SecondsSince(clock, start_us) - seconds_loading;
  } else if (package.compares) {
    const int64_t entered_us = clock.MonotonicUs();
    TESSERA_RETURN_IF_ERROR(sight->data_term.EnterLevel(task.step.level));
    seconds_loading += SecondsSince(clock, entered_us);
    TriangleMesh mesh = {std::move(task.snapshot.positions), package.mesh.faces, {}};
    if (GeometryKnowsLabels(package, task.options)) mesh.labels = std::move(task.snapshot.labels);
    FaceDerivatives derivatives;
    sight->data_term.Evaluate(mesh, work.measured(), &clock, &derivatives);
    sight->data_term.ReleaseBuffers();
    FillDerivatives(work, derivatives, &sums);
    stats["seconds_visibility"] = derivatives.photo.seconds_visibility;
    stats["seconds_data"] = derivatives.photo.seconds_photo;
    stats["warped_pixels"] = derivatives.photo.warped_pixels;
  }
  control.Report(0.95, "writing sums");
  TESSERA_RETURN_IF_ERROR(WriteTileSums(OutputPath(request, kSumsFile), sums));
  TaskOutcome outcome;
  outcome.outputs = {kSumsFile};
  stats["seconds_loading"] = seconds_loading;
  stats["seconds"] = SecondsSince(clock, start_us);
  outcome.stats = stats.dump();
  return outcome;
}

}  // namespace tessera
