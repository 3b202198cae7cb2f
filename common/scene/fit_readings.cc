#include "common/scene/fit_readings.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <functional>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

constexpr double kFoot_m = 0.3048;
constexpr double kFits_px = 0.75;  // median offsets under a right reading
// Enough to tell a fit from chance.
constexpr FitOptions kSmall = {.pairs = 16, .patches = 60};

struct Candidate {
  std::string fault;
  std::function<void(SceneDescription* scene, TriangleMesh* mesh)> correct;
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

Candidate OfMesh(std::string fault, const Eigen::Matrix3d& corrected_from_mesh) {
  return {std::move(fault), [corrected_from_mesh](SceneDescription* scene, TriangleMesh* mesh) {
            for (Eigen::Vector3d& p : mesh->vertices) {
              p = scene->frame.LocalFromScene(corrected_from_mesh * scene->frame.SceneFromLocal(p));
            }
            if (corrected_from_mesh.determinant() > 0) return;
            for (auto& face : mesh->faces) std::swap(face[1], face[2]);
          }};
}

Candidate OfScale(const char* unit, double metres) {
  return OfMesh(absl::StrCat("the mesh is in ", unit, " and the cameras are in metres: multiply the mesh by ", metres),
                metres * Eigen::Matrix3d::Identity());
}

// The same camera for photographs that are stored turned by 180 degrees, or by +-90 degrees about the optical axis.
Candidate OfTurn(const char* fault, int cosine, int sine) {
  return {fault, [cosine, sine](SceneDescription* scene, TriangleMesh*) {
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

std::vector<Candidate> Candidates(const SceneDescription& scene) {
  std::vector<Candidate> all;
  const auto axes = [](int x, int y, int z) {  // rows of a signed permutation, by axis number from 1
    Eigen::Matrix3d m = Eigen::Matrix3d::Zero();
    const int of[3] = {x, y, z};
    for (int row = 0; row < 3; ++row) m(row, std::abs(of[row]) - 1) = of[row] > 0 ? 1 : -1;
    return m;
  };
  all.push_back(OfScale("feet", kFoot_m));
  all.push_back(OfScale("centimetres", 0.01));
  all.push_back(OfScale("millimetres", 0.001));
  all.push_back(OfScale("kilometres", 1000));
  all.push_back({"the cameras are in feet and the mesh is in metres: multiply camera positions by 0.3048",
                 [](SceneDescription* edited, TriangleMesh*) {
                   EditPoses(edited, [](Eigen::Matrix3d*, Eigen::Vector3d* t) { *t *= kFoot_m; });
                 }});
  all.push_back(OfMesh("y is up in the mesh, z in the cameras: map (x, y, z) to (x, -z, y)", axes(1, -3, 2)));
  all.push_back(
      OfMesh("y is down in the mesh, or y is up in the cameras: map (x, y, z) to (x, z, -y)", axes(1, 3, -2)));
  all.push_back(OfMesh("z points down in the mesh: map (x, y, z) to (x, -y, -z)", axes(1, -2, -3)));
  all.push_back(OfMesh("x and y are exchanged in the mesh (and z): map (x, y, z) to (y, x, -z)", axes(2, 1, -3)));
  all.push_back(OfMesh("x and y are exchanged in the mesh: map (x, y, z) to (y, x, z)", axes(2, 1, 3)));
  all.push_back(OfMesh("z is mirrored in the mesh: map (x, y, z) to (x, y, -z)", axes(1, 2, -3)));
  all.push_back(OfMesh("y is mirrored in the mesh: map (x, y, z) to (x, -y, z)", axes(1, -2, 3)));
  all.push_back(OfMesh("the mesh is turned by 180 degrees about z: map (x, y, z) to (-x, -y, z)", axes(-1, -2, 3)));
  all.push_back({"poses are camera-to-world: COLMAP stores world-to-camera; invert them",
                 [](SceneDescription* edited, TriangleMesh*) {
                   EditPoses(edited, [](Eigen::Matrix3d* r, Eigen::Vector3d* t) {
                     *t = -r->transpose() * *t;
                     r->transposeInPlace();
                   });
                 }});
  const Eigen::Matrix3d flip = axes(1, -2, -3);
  all.push_back({"cameras have OpenGL axes (y up, z backwards): COLMAP's have y down and z forwards",
                 [flip](SceneDescription* edited, TriangleMesh*) {
                   EditPoses(edited, [&flip](Eigen::Matrix3d* r, Eigen::Vector3d* t) {
                     *r = flip * *r;
                     *t = flip * *t;
                   });
                 }});
  all.push_back(
      {"quaternions are in the order x y z w: COLMAP's order is w x y z", [](SceneDescription* edited, TriangleMesh*) {
         EditPoses(edited, [](Eigen::Matrix3d* r, Eigen::Vector3d*) {
           const Eigen::Quaterniond q(*r);
           *r = Eigen::Quaterniond(q.z(), q.w(), q.x(), q.y()).normalized().toRotationMatrix();
         });
       }});
  all.push_back({"the principal point is wrong: it fits if it is in the middle of the images",
                 [](SceneDescription* edited, TriangleMesh*) {
                   for (SceneView& view : edited->views) {
                     view.camera.intrinsics.cx = 0.5 * view.camera.intrinsics.width;
                     view.camera.intrinsics.cy = 0.5 * view.camera.intrinsics.height;
                   }
                 }});
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

}  // namespace

StatusOr<Reading> FindReading(const SceneDescription& scene, const TriangleMesh& mesh, const SceneFit& fit,
                              const TaskControl& control) {
  Reading best;
  best.above_chance = std::max(2 * fit.all.above_chance, kBadFit);
  for (const Candidate& candidate : Candidates(scene)) {
    SceneDescription corrected = scene;
    TriangleMesh corrected_mesh = mesh;
    candidate.correct(&corrected, &corrected_mesh);
    TESSERA_ASSIGN_OR_RETURN(const SceneFit found, MeasureFit(corrected, corrected_mesh, kSmall, control));
    if (found.all.patches < 100 || found.all.above_chance <= best.above_chance) continue;
    // A wrong reading may match flat ground, but not where the mesh puts it.
    if (!(found.all.across_px >= 0 && found.all.across_px < kFits_px && found.all.along_px < 2 * kFits_px)) continue;
    best = {candidate.fault, found.all.above_chance};
  }
  if (best.fault.empty()) best.above_chance = fit.all.above_chance;
  return best;
}

}  // namespace tessera
