// The scene: the input contract (scene.json and all that it names).
#ifndef TESSERA_COMMON_SCENE_SCENE_H_
#define TESSERA_COMMON_SCENE_SCENE_H_

#include <Eigen/Core>
#include <array>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/geodesy/frame.h"
#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"
#include "common/storage/allowed_files.h"

namespace tessera {

struct SceneClass {
  std::string name;
  std::array<uint8_t, 3> color_rgb = {200, 200, 200};
  // Normal prior (paper, section 3.2): the class is penalised where the angle between the normal and up is further than
  // alpha from beta. alpha = pi: never.
  double prior_alpha_rad = 3.141592653589793;
  double prior_beta_rad = 0;
  double smoothness = 1;
  double keep = 0;  // how much its faces stay at the start, along their normals; in units of smoothness
};

struct Flight {
  std::string name;
  std::string date;  // ISO 8601, may be empty
};

// One image with its pose. Paths are relative to the scene's folder; `likelihood_path` is empty if it has none.
struct SceneView {
  std::string name;  // file name relative to the images folder, as COLMAP names it
  std::string image_path;
  std::string likelihood_path;
  LensModel lens;
  PosedCamera camera;  // undistorted; local frame
  int flight = -1;     // index into SceneDescription::flights; the first with a pattern for the name; -1: none is named
  // Hashes of what the files decode to, with these lenses (PixelContents): the same for files that only differ in how
  // they are written. Empty: not known, or no such file.
  std::string image_content = {}, likelihood_content = {};
  bool withdrawn = false;  // of an earlier job, and not used any more: keeps its number, is never chosen
};

// Everything about a scene but its pixels and its mesh. A plain value.
struct SceneDescription {
  std::string folder;  // where the paths start
  std::string name;
  std::vector<SceneClass> classes;
  std::vector<Flight> flights;
  Frame frame;                   // the scene's own coordinates <-> the local metric frame used inside
  Eigen::Vector3d up_in_local;   // unit
  std::vector<SceneView> views;  // in COLMAP's order of image ids
  std::string cameras_folder;    // of the COLMAP model, relative to folder
  std::string mesh_path;         // relative to folder
  bool has_likelihoods = false;
  bool mesh_has_labels = false;
  std::vector<std::string> files;  // every file of the scene that a job reads, relative to folder, sorted
};

// How the scene of a job that goes on from another is read.
struct SceneLoadOptions {
  // Files of the scene that lie elsewhere and are known to be good: they need not be in the folder.
  std::set<std::string> elsewhere = {};
  bool needs_mesh = true;           // false: without a mesh, the cameras and images add to those of another scene
  std::optional<Frame> frame = {};  // else one about its cameras; a scene in other coordinates is at fault
  bool all_classes = false;         // as scene.json has them, though nothing in the scene has a class yet
  // Likelihoods are made from the images later: there are some, and classes, but no likelihood_path; those in the
  // folder are not looked at. `by_default_rule`: not by what was learnt, of which users are warned.
  bool to_be_classified = false, by_default_rule = false;
  AllowedFiles allowed = AllowedFiles::All();  // nothing else is opened
};

// Reads scene.json, the camera model and the list of files. `path` is the scene's folder or its scene.json. Every fault
// that can be found without reading pixels or the mesh is in the returned INVALID_ARGUMENT, one a line.
StatusOr<SceneDescription> LoadScene(const std::string& path, Warnings* warnings,
                                     const SceneLoadOptions& options = SceneLoadOptions());

// The start mesh in the local frame, as stored in the file (not repaired). Refuses a float PLY whose rounding exceeds
// a hundredth of `gsd_m` (pass 0 to skip that test).
StatusOr<TriangleMesh> LoadSceneMesh(const SceneDescription& scene, double gsd_m);

// Median ground sampling distance over a fixed sample of faces and the views that face them (frustum only), metres: the
// width depth / focal length of a pixel on a surface that looks at the camera, not stretched by the angle of incidence.
// FAILED_PRECONDITION if no view sees any face.
StatusOr<double> MedianGsd(const SceneDescription& scene, const TriangleMesh& mesh);

}  // namespace tessera

#endif  // TESSERA_COMMON_SCENE_SCENE_H_
