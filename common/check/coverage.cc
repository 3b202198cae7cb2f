#include "common/check/coverage.h"

#include <algorithm>
#include <atomic>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/base/parallel.h"
#include "common/geometry/ray_caster.h"

namespace tessera {
namespace {

bool Faces(const TriangleMesh& mesh, int64_t face, const Eigen::Vector3d& centre) {
  return FaceCross(mesh, face).dot(mesh.Corner(face, 0) - centre) < 0;
}

ViewVisibility VisibilityOf(const SceneView& view, const TriangleMesh& mesh, const RayCaster& caster) {
  constexpr int kGrid = 16;
  const Eigen::Vector3d centre = view.camera.Centre();
  int fronts = 0, backs = 0;
  for (int y = 0; y < kGrid; ++y) {
    for (int x = 0; x < kGrid; ++x) {
      const Eigen::Vector3d ray = view.camera.Ray((x + 0.5) / kGrid * view.camera.intrinsics.width,
                                                  (y + 0.5) / kGrid * view.camera.intrinsics.height);
      const RayHit hit = caster.Cast(centre, ray);
      if (hit.hit()) ++(Faces(mesh, hit.face, centre) ? fronts : backs);
    }
  }
  if (backs > fronts) return ViewVisibility::kBehindMesh;
  if (fronts > 0) return ViewVisibility::kGood;
  // No ray of the grid hit the mesh; it may be small in the image, so test all faces.
  bool back_in_frustum = false;
  for (int64_t face = 0; face < static_cast<int64_t>(mesh.faces.size()); ++face) {
    if (!view.camera.InImage(view.camera.Project(MeshSpans(mesh).Centroid(face)))) continue;
    if (Faces(mesh, face, centre)) return ViewVisibility::kGood;
    back_in_frustum = true;
  }
  return back_in_frustum ? ViewVisibility::kBehindMesh : ViewVisibility::kNothing;
}

}  // namespace

StatusOr<Coverage> MeasureCoverage(const SceneDescription& scene, const TriangleMesh& mesh, int64_t largest_sample,
                                   const TaskControl& control) {
  Coverage coverage;
  for (const Eigen::Vector3d& p : mesh.vertices) coverage.box.extend(p);
  const RayCaster caster(mesh);
  const int64_t views = static_cast<int64_t>(scene.views.size());
  coverage.views.assign(views, ViewVisibility::kGood);
  ParallelForEach(views, 1, [&](int64_t i) {
    if (control.Check().ok()) coverage.views[i] = VisibilityOf(scene.views[i], mesh, caster);
  });
  const int64_t faces = static_cast<int64_t>(mesh.faces.size());
  const int64_t stride = std::max<int64_t>(1, (faces + largest_sample - 1) / std::max<int64_t>(largest_sample, 1));
  coverage.faces_tried = (faces + stride - 1) / stride;
  std::atomic<int64_t> unseen = 0, under_three = 0;
  ParallelFor(coverage.faces_tried, 1024, [&](int64_t begin, int64_t end) {
    if (!control.Check().ok()) return;
    int64_t chunk_unseen = 0, chunk_under_three = 0;
    for (int64_t i = begin; i < end; ++i) {
      const int64_t face = i * stride;
      const Eigen::Vector3d centroid = MeshSpans(mesh).Centroid(face);
      int seen = 0;
      for (int64_t v = 0; v < views && seen < 3; ++v) {
        const PosedCamera& camera = scene.views[v].camera;
        const Eigen::Vector3d projected = camera.Project(centroid), centre = camera.Centre();
        if (!camera.InImage(projected) || !Faces(mesh, face, centre)) continue;
        // End the ray before the face by 1/1000 of the distance, so that the face and its neighbours do not occlude it.
        if (!caster.Occluded(centre, centroid, 1e-3 * (centroid - centre).norm())) ++seen;
      }
      chunk_unseen += seen == 0;
      chunk_under_three += seen < 3;
    }
    unseen += chunk_unseen;
    under_three += chunk_under_three;
  });
  TESSERA_RETURN_IF_ERROR(control.Check());
  coverage.unseen = unseen;
  coverage.under_three = under_three;
  return coverage;
}

void AddVisibilityFaults(const SceneDescription& scene, const Coverage& coverage, Faults* faults) {
  constexpr double kAlmostAll = 0.9;
  const auto almost_all = [&](int64_t views) {
    return views > 1 && static_cast<double>(views) > kAlmostAll * static_cast<double>(coverage.views.size());
  };
  const std::string path = absl::StrCat(scene.folder, "/", scene.mesh_path);
  const auto behind = std::count(coverage.views.begin(), coverage.views.end(), ViewVisibility::kBehindMesh);
  const bool inwards = almost_all(behind);
  const auto blind = std::count(coverage.views.begin(), coverage.views.end(), ViewVisibility::kNothing);
  const bool elsewhere = almost_all(blind);
  if (elsewhere) {
    Eigen::Vector3d cameras = Eigen::Vector3d::Zero();
    for (const SceneView& view : scene.views) cameras += view.camera.Centre() / static_cast<double>(scene.views.size());
    const auto text = [&](const Eigen::Vector3d& p_local) {
      const Eigen::Vector3d p = scene.frame.SceneFromLocal(p_local);
      return absl::StrFormat("(%.1f, %.1f, %.1f)", p.x(), p.y(), p.z());
    };
    faults->Add(InputError(
        path, "",
        absl::StrCat("a mesh around ", text(coverage.box.center()), " that ", blind, " of ", coverage.views.size(),
                     " images do not see; their cameras are around ", text(cameras)),
        "mesh and cameras in one coordinate system: add the offset that the mesh's program keeps beside it (such as "
        "metadata.xml), and check units, axes and poses"));
  }
  if (inwards) {
    faults->Add(InputError(
        path, "", absl::StrCat("faces whose backs are seen by ", behind, " of ", coverage.views.size(), " images"),
        "faces whose corners are counter-clockwise seen from outside: turn the mesh's faces, which "
        "are oriented inwards, or check its up axis and the poses"));
  }
  for (size_t i = 0; i < coverage.views.size(); ++i) {
    const std::string image = absl::StrCat("image '", scene.views[i].name, "'");
    if (coverage.views[i] == ViewVisibility::kNothing && !elsewhere) {
      faults->Add(InputError(path, image, "no face in front of its camera and inside the image",
                             "a camera that sees the mesh: check its pose"));
    } else if (coverage.views[i] == ViewVisibility::kBehindMesh && !inwards) {
      faults->Add(InputError(path, image, "mostly backs of faces: its camera is behind the mesh",
                             "a camera that sees the front of the mesh: check its pose and the orientation of faces"));
    }
  }
}

}  // namespace tessera
