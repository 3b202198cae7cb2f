// Loading of a scene's start mesh, and its ground sampling distance (GSD).
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "common/base/parallel.h"
#include "common/base/printable.h"
#include "common/meshio/mesh_format.h"
#include "common/scene/scene.h"

namespace tessera {
namespace {

// Largest rounding error of a coordinate of this size as a 32-bit float: half a unit in the last place.
double FloatRounding(double coordinate) {
  if (coordinate == 0) return 0;
  return std::ldexp(1.0, std::ilogb(coordinate) - 24);
}

}  // namespace

Status CheckFloatRounding(const std::string& mesh_path, double largest_m, double gsd_m) {
  const double rounding_m = FloatRounding(largest_m);
  if (rounding_m <= gsd_m / 100) return absl::OkStatus();
  return InputError(mesh_path, "header",
                    absl::StrCat("x, y, z as 32-bit floats, which round coordinates of ", largest_m, " m by up to ",
                                 rounding_m, " m"),
                    absl::StrCat("doubles, because the rounding exceeds 1/100 of the GSD (", gsd_m, " m)"));
}

Status CheckFaceLabel(const SceneDescription& scene, const std::string& mesh_path, size_t face, int32_t label,
                      const std::string& label_property) {
  const int classes = static_cast<int>(scene.classes.size());
  if (label >= -1 && label < classes) return absl::OkStatus();
  // A property of another name may hold something else.
  const bool is_sure = label_property == "label" || scene.label_property;
  return InputError(
      mesh_path, absl::StrCat("face ", face), absl::StrCat("label ", label),
      absl::StrCat("0 to ", classes - 1, " (index into classes), or -1 for no label",
                   is_sure ? ""
                           : absl::StrCat("; if '", Printable(label_property),
                                          "' holds no labels, set \"label_property\": null in scene.json")));
}

StatusOr<TriangleMesh> LoadSceneMesh(const SceneDescription& scene, double gsd_m, Warnings* warnings) {
  if (scene.mesh_path.empty()) return InputError(scene.folder, "", "no mesh", "a scene with a mesh");
  const std::string path = absl::StrCat(scene.folder, "/", scene.mesh_path);
  TESSERA_ASSIGN_OR_RETURN(MeshContent content, ReadMesh(path, {scene.label_property, warnings, scene.mesh_path}));
  TriangleMesh& mesh = content.mesh;
  if (mesh.faces.empty()) return InputError(path, "", "no faces", "at least one face");
  for (size_t f = 0; f < mesh.labels.size(); ++f) {
    TESSERA_RETURN_IF_ERROR(CheckFaceLabel(scene, path, f, mesh.labels[f], content.label_property));
  }
  if (content.float_positions && gsd_m > 0) {
    double largest = 0;
    for (const Eigen::Vector3d& p : mesh.vertices) largest = std::max(largest, p.cwiseAbs().maxCoeff());
    TESSERA_RETURN_IF_ERROR(CheckFloatRounding(path, largest, gsd_m));
  }
  for (Eigen::Vector3d& p : mesh.vertices) p = scene.frame.LocalFromScene(p);
  return std::move(mesh);
}

std::optional<std::string> LabelPropertyOf(const SceneDescription& scene, const std::string& path) {
  std::error_code error;  // false if a file does not exist
  if (std::filesystem::equivalent(path, absl::StrCat(scene.folder, "/", scene.mesh_path), error)) {
    return scene.label_property;
  }
  return {};
}

StatusOr<double> MedianGsd(const SceneDescription& scene, const TriangleMesh& mesh) {
  constexpr int64_t kSamples = 4096;
  const int64_t faces = static_cast<int64_t>(mesh.faces.size());
  const int64_t samples = std::min(faces, kSamples);
  constexpr int64_t kGrain = 64;
  std::vector<std::vector<double>> chunks((samples + kGrain - 1) / kGrain);
  ParallelForEach(samples, kGrain, [&](int64_t i) {
    const int64_t face = i * faces / samples;
    const Eigen::Vector3d centroid = MeshSpans(mesh).Centroid(face);
    const Eigen::Vector3d normal = FaceCross(mesh, face);
    for (const SceneView& view : scene.views) {
      const Eigen::Vector3d projected = view.camera.Project(centroid);
      if (!view.camera.InImage(projected) || normal.dot(centroid - view.camera.Centre()) >= 0) continue;
      const PinholeCamera& camera = view.camera.intrinsics;
      chunks[i / kGrain].push_back(projected.z() / std::sqrt(camera.fx * camera.fy));
    }
  });
  std::vector<double> gsds;
  for (const std::vector<double>& chunk : chunks) gsds.insert(gsds.end(), chunk.begin(), chunk.end());
  if (gsds.empty())
    return absl::FailedPreconditionError("no view sees any face of the mesh: check the camera poses and crs");
  std::nth_element(gsds.begin(), gsds.begin() + gsds.size() / 2, gsds.end());
  return gsds[gsds.size() / 2];
}

}  // namespace tessera
