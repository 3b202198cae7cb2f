#include "common/check/fit_readings.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <set>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/base/parallel.h"
#include "common/check/fit_pairs.h"
#include "common/geometry/ray_caster.h"

namespace tessera {
namespace {

constexpr double kFoot_m = 0.3048;
// Under a right reading, the largest median offset across the epipolar lines, and half of that along them; and under a
// reading that is only near the truth.
constexpr double kFits_px = 0.75, kNear_px = 4;
// Maps that move a unit vector of the up direction by less keep it.
constexpr double kSameUp = 0.5;
constexpr double kFocalErrors[] = {0.005, 0.01, 0.015, 0.02, 0.03};  // that are tried, relative
// Enough to tell a fit from chance.
constexpr FitOptions kSmall = {.pairs = 16, .patches = 60};
// With fewer patches, only a small part of the surface matches, such as walls, which many readings leave in their
// planes.
constexpr int64_t kLeastPatchesOfReading = kSmall.pairs * kSmall.patches / 4;
constexpr FitOptions kOfShift = {.pairs = 40, .patches = 300};
constexpr int64_t kSmallImage = 1'500'000, kKeptImages = 48;
// A shift is searched from this far above and below, and then around the best place, with halved steps.
constexpr double kHighestShift_m = 60, kFirstStep_m = 4, kLastStep_m = 0.2;
constexpr int kMostMoves = 20;
// A reading or shift is significant if the patches that match by it, less those that match no more, exceed this many
// standard deviations of their number by chance. Patches share images and pixels: about two of them count for one.
constexpr double kSignificantDeviations = 5, kSuspectedDeviations = 1, kPatchesOfOne = 2;

struct Candidate {
  std::string fault;
  std::function<void(SceneDescription* scene)> correct;
  enum class Faces { kBoth, kInwards, kOutwards };
  Faces faces = Faces::kBoth;  // repair turns a mesh to the side that the cameras see, so wrong poses turn a right one
  bool keeps_up = false;       // the up direction of the mesh stays
  double fits_px = kFits_px;
};

// Edits poses in scene coordinates.
template <class Edit>
void EditPoses(SceneDescription* scene, const Edit& edit) {
  const Eigen::Matrix3d local_from_scene = scene->frame.rotation_local_from_scene();
  const Eigen::Vector3d origin = scene->frame.origin_in_scene();
  for (SceneView& view : scene->views) {
    Eigen::Matrix3d rotation = view.camera.rotation_cam_from_world * local_from_scene;
    Eigen::Vector3d translation = view.camera.translation_cam_from_world - rotation * origin;
    edit(&rotation, &translation);
    view.camera.rotation_cam_from_world = rotation * local_from_scene.transpose();
    view.camera.translation_cam_from_world = translation + rotation * origin;
  }
}

// A mesh that must be multiplied by `scale` and `axes`, an orthogonal matrix. The cameras get the inverse instead,
// since all candidates share the mesh's points and rays.
Candidate OfMesh(std::string fault, double scale, const Eigen::Matrix3d& axes) {
  return {std::move(fault), [scale, axes](SceneDescription* scene) {
            EditPoses(scene, [&](Eigen::Matrix3d* r, Eigen::Vector3d* t) {
              *r = *r * axes;
              *t /= scale;
            });
          }};
}

Candidate OfScale(const char* unit, double metres) {
  return OfMesh(absl::StrCat("the mesh is in ", unit, " and the cameras are in metres: multiply the mesh by ", metres),
                metres, Eigen::Matrix3d::Identity());
}

// Rows of a signed permutation, by axis number from 1.
Eigen::Matrix3d Axes(int x, int y, int z) {
  Eigen::Matrix3d m = Eigen::Matrix3d::Zero();
  const int of[3] = {x, y, z};
  for (int row = 0; row < 3; ++row) m(row, std::abs(of[row]) - 1) = of[row] > 0 ? 1 : -1;
  return m;
}

std::string AxesFault(int x, int y, int z) {
  const auto name = [](int axis) {
    return absl::StrCat(axis < 0 ? "-" : "", axis * axis == 1 ? "x" : axis * axis == 4 ? "y" : "z");
  };
  const struct {
    int x, y, z;
    const char* meaning;
  } known[] = {{1, -3, 2, "y is up in the mesh, z in the cameras"},
               {1, 3, -2, "y is down in the mesh, or y is up in the cameras"},
               {1, -2, -3, "z points down in the mesh"},
               {2, 1, -3, "x and y are exchanged in the mesh (and z)"},
               {2, 1, 3, "x and y are exchanged in the mesh"},
               {1, 2, -3, "z is mirrored in the mesh"},
               {1, -2, 3, "y is mirrored in the mesh"},
               {-1, 2, 3, "x is mirrored in the mesh"},
               {-1, -2, 3, "the mesh is turned by 180 degrees about z"},
               {-2, 1, 3, "the mesh is turned by 90 degrees about z"},
               {2, -1, 3, "the mesh is turned by 90 degrees about z"}};
  const char* meaning = "the axes of the mesh are not those of the cameras";
  for (const auto& each : known) {
    if (each.x == x && each.y == y && each.z == z) meaning = each.meaning;
  }
  return absl::StrCat(meaning, ": map (x, y, z) to (", name(x), ", ", name(y), ", ", name(z), ")");
}

// The same camera for photographs that are stored turned by 180 degrees, or by +-90 degrees about the optical axis.
Candidate OfTurn(const char* fault, int cosine, int sine) {
  return {fault, [cosine, sine](SceneDescription* scene) {
            Eigen::Matrix3d turn;
            turn << cosine, -sine, 0, sine, cosine, 0, 0, 0, 1;
            for (SceneView& view : scene->views) {
              PinholeCamera& c = view.camera.intrinsics;
              const Eigen::Vector2d middle(0.5 * c.width, 0.5 * c.height);
              const Eigen::Vector2d principal =
                  turn.topLeftCorner<2, 2>() * (Eigen::Vector2d(c.cx, c.cy) - middle) + middle;
              c.cx = principal.x(), c.cy = principal.y();
              view.camera.rotation_cam_from_world = turn * view.camera.rotation_cam_from_world;
              view.camera.translation_cam_from_world = turn * view.camera.translation_cam_from_world;
            }
          }};
}

// Focal lengths that are wrong by `error`.
Candidate OfFocal(double error) {
  Candidate made{absl::StrFormat("each camera has focal lengths that are about %.1f %% too %s: divide them by %.3f",
                                 100 * std::abs(error), error > 0 ? "large" : "small", 1 + error),
                 [error](SceneDescription* scene) {
                   for (SceneView& view : scene->views) {
                     view.camera.intrinsics.fx /= 1 + error;
                     view.camera.intrinsics.fy /= 1 + error;
                   }
                 }};
  made.fits_px = kNear_px;
  made.faces = Candidate::Faces::kOutwards;
  return made;
}

std::vector<Candidate> Candidates(const SceneDescription& scene) {
  const Eigen::Vector3d up = scene.frame.rotation_local_from_scene().transpose() * scene.up_in_local;
  std::vector<Candidate> all;
  all.push_back(OfScale("feet", kFoot_m));
  all.push_back(OfScale("centimetres", 0.01));
  all.push_back(OfScale("millimetres", 0.001));
  all.push_back(OfScale("kilometres", 1000));
  all.push_back({"the cameras are in feet and the mesh is in metres: multiply camera positions by 0.3048",
                 [](SceneDescription* edited) {
                   EditPoses(edited, [](Eigen::Matrix3d*, Eigen::Vector3d* t) { *t *= kFoot_m; });
                 }});
  all.push_back(
      {"the faces of the mesh are oriented inwards: turn them", [](SceneDescription*) {}, Candidate::Faces::kInwards});
  int order[3] = {1, 2, 3};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      const int x = signs & 1 ? -order[0] : order[0], y = signs & 2 ? -order[1] : order[1];
      const int z = signs & 4 ? -order[2] : order[2];
      if (x == 1 && y == 2 && z == 3) continue;
      all.push_back(OfMesh(AxesFault(x, y, z), 1, Axes(x, y, z)));
      all.back().keeps_up = (Axes(x, y, z) * up - up).norm() < kSameUp;
    }
  } while (std::next_permutation(order, order + 3));
  all.push_back({"poses are camera-to-world: COLMAP stores world-to-camera; invert them", [](SceneDescription* edited) {
                   EditPoses(edited, [](Eigen::Matrix3d* r, Eigen::Vector3d* t) {
                     *t = -r->transpose() * *t;
                     r->transposeInPlace();
                   });
                 }});
  const Eigen::Matrix3d flip = Axes(1, -2, -3);
  all.push_back({"cameras have OpenGL axes (y up, z backwards): COLMAP's have y down and z forwards",
                 [flip](SceneDescription* edited) {
                   EditPoses(edited, [&flip](Eigen::Matrix3d* r, Eigen::Vector3d* t) {
                     *r = flip * *r;
                     *t = flip * *t;
                   });
                 }});
  all.push_back({"quaternions are in the order x y z w: COLMAP's order is w x y z", [](SceneDescription* edited) {
                   EditPoses(edited, [](Eigen::Matrix3d* r, Eigen::Vector3d*) {
                     const Eigen::Quaterniond q(*r);
                     *r = Eigen::Quaterniond(q.z(), q.w(), q.x(), q.y()).normalized().toRotationMatrix();
                   });
                 }});
  all.push_back(
      {"the principal point is wrong: it fits if it is in the middle of the images", [](SceneDescription* edited) {
         for (SceneView& view : edited->views) {
           view.camera.intrinsics.cx = 0.5 * view.camera.intrinsics.width;
           view.camera.intrinsics.cy = 0.5 * view.camera.intrinsics.height;
         }
       }});
  all.back().fits_px = kNear_px;
  for (const double error : kFocalErrors) {
    for (const double sign : {-1.0, 1.0}) all.push_back(OfFocal(sign * error));
  }
  all.push_back(OfTurn("the photographs are turned by 180 degrees against the poses", -1, 0));
  const bool square = std::all_of(scene.views.begin(), scene.views.end(), [](const SceneView& view) {
    return view.camera.intrinsics.width == view.camera.intrinsics.height;
  });
  if (square) {
    all.push_back(OfTurn("the photographs are turned by 90 degrees clockwise against the poses", 0, 1));
    all.push_back(OfTurn("the photographs are turned by 90 degrees anticlockwise against the poses", 0, -1));
  }
  return all;
}

// A mesh whose correlations are measured again and again.
class Trials {
 public:
  Trials(const SceneDescription& scene, const FitSurface& surface, const FetchFiles& fetch)
      : scene_(scene),
        caster_(*surface.occluders),
        margin_m_(surface.margin_m),
        points_(SpreadPoints(surface.mesh, FitPointsFor(scene))),
        inward_points_(points_),
        images_(scene, fetch, kSmallImage, kKeptImages) {
    for (SurfacePoint& point : inward_points_) point.normal = -point.normal;
  }

  StatusOr<SceneFit> Fit(const SceneDescription& corrected, bool inwards, const TaskControl& control) {
    TESSERA_ASSIGN_OR_RETURN(
        const std::vector<FitPair> pairs,
        FindFitPairs(corrected, inwards ? inward_points_ : points_, caster_, margin_m_, kSmall, control));
    std::vector<FitMatches> measured(pairs.size());
    TESSERA_RETURN_IF_ERROR(ForEachFitPair(pairs, &images_, control, [&](size_t p) {
      const FitPair& pair = pairs[p];
      const auto matches = MatchPoints(images_.At(corrected, pair.reference), images_.At(corrected, pair.other),
                                       pair.points, static_cast<uint32_t>(p * 1000));
      measured[p] = {pair.reference, pair.other, images_.Scale(pair.reference), {}};
      for (size_t i = 0; i < matches.size(); ++i) {
        if (matches[i]) measured[p].matches.push_back({pair.points[i], *matches[i]});
      }
    }));
    return SumUpFit(corrected, measured);
  }

  // Sets shift_m and above_chance of `reading` if a shift of the mesh is significantly better than none. `far`: also
  // one that is too large to match in place.
  Status FindShift(double gsd_m, bool far, const TaskControl& control, Reading* reading) {
    TESSERA_ASSIGN_OR_RETURN(const std::vector<FitPair> pairs,
                             FindFitPairs(scene_, points_, caster_, margin_m_, kOfShift, control));
    if (pairs.empty()) return absl::OkStatus();
    std::set<int> views;
    for (const FitPair& pair : pairs) views.insert({pair.reference, pair.other});
    TESSERA_RETURN_IF_ERROR(images_.Require(views));
    std::vector<FitMatches> in_place;
    std::vector<Patch> patches;
    for (const FitPair& pair : pairs) {
      const PatchView reference = images_.At(scene_, pair.reference), other = images_.At(scene_, pair.other);
      const auto matches = MatchPoints(reference, other, pair.points, static_cast<uint32_t>(in_place.size() * 1000));
      FitMatches& of_pair = in_place.emplace_back(FitMatches{pair.reference, pair.other, 1, {}});
      for (size_t i = 0; i < matches.size(); ++i) {
        if (!matches[i]) continue;
        of_pair.matches.push_back({pair.points[i], *matches[i]});
        patches.push_back({reference, other, pair.points[i]});
      }
    }
    const double limit = ChanceLimit(in_place);
    // Of each patch, whether it matches with the mesh moved.
    const auto matches_at = [&](const Eigen::Vector3d& shift_m) {
      std::vector<uint8_t> above(patches.size());
      ParallelForEach(patches.size(), 64, [&](size_t i) {
        const Patch& patch = patches[i];
        above[i] =
            CorrelatePatch(patch.reference, patch.other, {patch.point.position + shift_m, patch.point.normal}) > limit;
      });
      return above;
    };
    const auto count = [](const std::vector<uint8_t>& above) { return std::count(above.begin(), above.end(), 1); };

    const Eigen::Vector3d up = scene_.up_in_local, side = up.unitOrthogonal(), front = up.cross(side);
    const std::vector<uint8_t> start = matches_at(Eigen::Vector3d::Zero());
    Eigen::Vector3d best_m = Eigen::Vector3d::Zero();
    std::vector<uint8_t> best = start;
    const auto try_shift = [&](const Eigen::Vector3d& shift_m) {
      std::vector<uint8_t> above = matches_at(shift_m);
      if (count(above) <= count(best)) return false;
      best = std::move(above);
      best_m = shift_m;
      return true;
    };
    if (far) {
      const double step_m = std::max(1.0, 4 * gsd_m);
      for (double z = -kHighestShift_m; z <= kHighestShift_m; z += step_m) {
        TESSERA_RETURN_IF_ERROR(control.Check());
        try_shift(z * up);
      }
    }
    int moves = 0;
    for (double step_m = kFirstStep_m; step_m >= std::max(kLastStep_m, 0.5 * gsd_m); step_m /= 2) {
      for (bool better = true; better && moves < kMostMoves; ++moves) {
        TESSERA_RETURN_IF_ERROR(control.Check());
        const Eigen::Vector3d from_m = best_m;
        better = false;
        for (const Eigen::Vector3d& way : {side, front, up, Eigen::Vector3d((side + front) / std::numbers::sqrt2),
                                           Eigen::Vector3d((side - front) / std::numbers::sqrt2)}) {
          for (const double sign : {-1.0, 1.0}) better |= try_shift(from_m + sign * step_m * way);
        }
      }
    }
    double more = 0, less = 0;
    for (size_t i = 0; i < patches.size(); ++i) {
      more += best[i] > start[i];
      less += best[i] < start[i];
    }
    if (!(more - less > kSignificantDeviations * std::sqrt(kPatchesOfOne * (more + less)))) return absl::OkStatus();
    reading->mesh_shift_m = best_m;
    reading->above_chance = static_cast<double>(count(best)) / static_cast<double>(patches.size());
    return absl::OkStatus();
  }

 private:
  struct Patch {
    PatchView reference, other;
    SurfacePoint point;
  };

  const SceneDescription& scene_;
  const RayCaster caster_;
  const double margin_m_;
  const std::vector<SurfacePoint> points_;
  std::vector<SurfacePoint> inward_points_;
  FitImages images_;
};

// Patches that match count, not their share: a wrong reading may have few patches that match well.
double Matching(const SceneFit& fit) { return fit.all.above_chance * static_cast<double>(fit.all.patches); }

// How many more patches match, in standard deviations of the difference by chance.
double DeviationsBetter(const SceneFit& fit, const SceneFit& than) {
  const double variance =
      kPatchesOfOne * (Matching(fit) * (1 - fit.all.above_chance) + Matching(than) * (1 - than.all.above_chance));
  return (Matching(fit) - Matching(than)) / std::sqrt(std::max(variance, 1.0));
}

}  // namespace

StatusOr<Reading> FindReading(const SceneDescription& scene, const FitSurface& surface, const SceneFit& fit,
                              double gsd_m, const ReadingSearch& search, const TaskControl& control,
                              const FetchFiles& fetch) {
  Trials trials(scene, surface, fetch);
  Reading best;
  best.above_chance = fit.all.above_chance;
  TESSERA_ASSIGN_OR_RETURN(const SceneFit as_is, trials.Fit(scene, false, control));
  SceneFit best_fit = as_is;
  for (const Candidate& candidate : Candidates(scene)) {
    if (!search.all && !candidate.keeps_up) continue;
    SceneDescription corrected = scene;
    candidate.correct(&corrected);
    for (const bool inwards : {false, true}) {
      if (candidate.faces == (inwards ? Candidate::Faces::kOutwards : Candidate::Faces::kInwards)) continue;
      if (inwards && !search.all) continue;
      TESSERA_ASSIGN_OR_RETURN(const SceneFit found, trials.Fit(corrected, inwards, control));
      if (found.all.patches < kLeastPatchesOfReading || found.all.above_chance < kBadFit) continue;
      // A wrong reading may match flat ground, but not where the mesh puts it.
      if (!(found.all.across_px >= 0 && found.all.across_px < candidate.fits_px &&
            found.all.along_px < 2 * candidate.fits_px))
        continue;
      // In a scene that fits, a reading is suspected first, and then measured with as many patches as the scene.
      const double least_deviations = search.all ? kSignificantDeviations : kSuspectedDeviations;
      if (Matching(found) <= Matching(best_fit) || DeviationsBetter(found, as_is) < least_deviations) continue;
      double above_chance = found.all.above_chance;
      if (!search.all) {
        TESSERA_ASSIGN_OR_RETURN(const SceneFit measured, MeasureFit(corrected, surface, FitOptions(), control, fetch));
        if (DeviationsBetter(measured, fit) < kSignificantDeviations) continue;
        above_chance = measured.all.above_chance;
      }
      best_fit = found;
      best = {candidate.fault, above_chance, Eigen::Vector3d::Zero()};
    }
  }
  if (!search.all && (!search.shift || !best.fault.empty())) return best;
  Reading moved;
  moved.above_chance = fit.all.above_chance;
  TESSERA_RETURN_IF_ERROR(trials.FindShift(gsd_m, search.all, control, &moved));
  const double least = std::max({2 * fit.all.above_chance, kBadFit, best.fault.empty() ? 0 : best.above_chance});
  if (!best.fault.empty() && moved.above_chance <= least) return best;
  best = moved;
  if (search.all && best.above_chance > least) {
    const Eigen::Vector3d shift_m = scene.frame.rotation_local_from_scene().transpose() * best.mesh_shift_m;
    best.fault = absl::StrFormat("the mesh has another offset: move it by (%.1f, %.1f, %.1f) m", shift_m.x(),
                                 shift_m.y(), shift_m.z());
  }
  return best;
}

}  // namespace tessera
