// The scene: scene.json and the files that it names. common/scene/README.md describes the formats.
#pragma once

#include <Eigen/Core>
#include <array>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/geodesy/frame.h"
#include "common/geodesy/reference_system.h"
#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"
#include "common/imaging/image_header.h"
#include "common/imaging/image_io.h"
#include "common/imaging/likelihood_form.h"
#include "common/storage/allowed_files.h"

namespace tessera {

struct SceneClass {
  std::string name;
  std::array<uint8_t, 3> color_rgb = {200, 200, 200};
  // Normal prior (paper, section 3.2): a face of this class is penalised if the angle between its normal and up differs
  // from beta by more than alpha. alpha = pi: no prior.
  double prior_alpha_rad = 3.141592653589793;
  double prior_beta_rad = 0;
  double smoothness = 1;
  double anchor_weight = 0;  // pulls faces to their start position along their normals; in units of smoothness
};

struct Flight {
  std::string name;
  std::string date;  // ISO 8601, may be empty
};

// One image with its pose. Paths are relative to the scene's folder; `likelihood_path` is empty without likelihoods.
struct SceneView {
  std::string name;  // of its file, relative to the images folder; the COLMAP model may write it in another form
  std::string image_path;
  std::string likelihood_path;
  LensModel lens;
  PosedCamera camera;  // undistorted; local frame
  int flight = -1;     // index into SceneDescription::flights: the first whose pattern matches the name; -1: none
  // Hashes of the decoded, undistorted files (PixelContent): equal for files that differ in their encoding only. Empty:
  // unknown, or no such file.
  std::string image_content = {}, likelihood_content = {};
  LikelihoodForm likelihood_form = {};  // of its file: as scene.json states it, completed by FindLikelihoodForms
  bool withdrawn = false;               // a view of the base job that is no longer used; it keeps its index
  std::string mask_path = {};           // empty: no mask
  // It has a mask or an alpha channel: pixels without luminance are no evidence. Ingest resets it if nothing is masked.
  bool masked = false;
  int white_level = 0;  // PhotographOptions::white_level; chosen when pixels are read (ChooseWhiteLevels)
};

// An image of the camera model that is left out. `reason`: what is wrong with its file, such as "no such file".
struct SkippedImage {
  std::string name, reason;
};

// A rectangle in plan.
struct PlanRect {
  double x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  bool IsEmpty() const { return !(x0 < x1 && y0 < y1); }
  bool operator==(const PlanRect&) const = default;
};

// Where an imported scene comes from ("source" in scene.json), to bring results back to it. The mesh's files state
// their system and offset; without a mesh these are the block's.
struct SceneSource {
  std::string crs;  // of the source, as PROJ reads it, or ENU:LAT,LON[,H]; empty: local
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();  // added to coordinates of the source's files, in units of crs
  std::vector<std::string> tiles = {};               // names of the mesh's tiles; empty: one mesh
  // The bounding rectangle of each tile, in coordinates of its file (without the offset). IsEmpty() if the tile has no
  // area in plan. No entries: not known.
  std::vector<PlanRect> tile_rects = {};
  HeightOptions heights = {};  // with which heights of `crs` were read
  bool operator==(const SceneSource&) const = default;
};

// A scene without its pixels and its mesh.
struct SceneDescription {
  std::string folder;  // paths below are relative to it
  std::string name;
  std::vector<SceneClass> classes;
  std::vector<Flight> flights;
  std::optional<SceneSource> source = {};
  Frame frame;                   // transform between scene coordinates and the local metric frame
  Eigen::Vector3d up_in_local;   // unit vector
  std::vector<SceneView> views;  // by the names of their image files
  std::string cameras_folder;    // of the COLMAP model, relative to folder
  std::string mesh_path;         // relative to folder
  // Of the mesh: the property with the labels. Empty: labels are ignored. None: it is found by its name.
  std::optional<std::string> label_property;
  bool has_likelihoods = false;
  bool mesh_has_labels = false;
  std::vector<std::string> files;     // every file of the scene that a job reads, relative to folder, sorted
  std::vector<SkippedImage> skipped;  // images without a view, if SceneLoadOptions::skip_images allows them
  int64_t unusable_images = 0;        // images whose files are missing or broken and are not skipped
};

// The class of a scene without labels and likelihoods.
SceneClass OneClass();

// The names of the scene's classes, in order.
std::vector<std::string> ClassNames(const SceneDescription& scene);

// The names, without extension, of files that belong to one view each, such as likelihoods: the image's name without
// its extension, or the whole name if two images differ in their extensions only.
std::vector<std::string> ViewStems(const SceneDescription& scene);

// Completes the likelihood_form of all views by the content of the likelihood files (FindLikelihoodForm), which must
// lie in the scene's folder. `known`: forms by likelihood_path of files that are not read. Others then get the same
// form, if it is a special one and scene.json states none. `contents`: by likelihood_path, of files that need not be
// read.
void FindLikelihoodForms(SceneDescription* scene, Warnings* warnings,
                         const std::map<std::string, LikelihoodForm>& known = {},
                         const std::map<std::string, LabelContent>& contents = {});

// What is read of a mesh to find out whether it has labels.
inline constexpr int64_t kMeshHeadBytes = 1 << 16;

// The first five are for scenes whose files are not all at hand, and for scenes of updates, which continue a base job.
struct SceneLoadOptions {
  // Paths of files that are stored elsewhere and were already read: they need not exist in the folder.
  std::set<std::string> elsewhere = {};
  // Of images and masks among them, where known; or why their headers cannot be read.
  std::map<std::string, StatusOr<ImageHeader>> headers_elsewhere = {};
  // Of a mesh among them: the first kMeshHeadBytes. Without it the base job has checked the mesh.
  std::map<std::string, std::string> heads_elsewhere = {};
  bool needs_mesh = true;  // false: the mesh may be missing, because the scene extends that of the base job
  // The base job's frame; a scene with another crs is an error. None: a frame around the cameras.
  std::optional<Frame> frame = {};
  bool all_classes = false;  // use the classes of scene.json even without labels and likelihoods
  // `to_be_classified`: the job computes the likelihoods; views have no likelihood_path, and a likelihoods folder is
  // ignored. `by_default_rule`: it uses the default rule instead of a trained classifier, which adds a warning.
  bool to_be_classified = false, by_default_rule = false;
  AllowedFiles allowed = AllowedFiles::All();  // only these files may be opened
  // Largest share of the images that may be left out because their files are missing or cannot be decoded; 0: they are
  // errors. Files that exist stay among SceneDescription::files, so that every process leaves out the same images.
  double skip_images = 0;
  // CheckScene warns where images, poses and mesh do not fit, or likelihoods and labels, instead of refusing.
  bool anyway = false;
};

// Reads scene.json, the camera model and the list of files. `path` is the scene's folder or its scene.json.
// INVALID_ARGUMENT lists all errors that can be found without reading pixels or the mesh, one per line.
StatusOr<SceneDescription> LoadScene(const std::string& path, Warnings* warnings,
                                     const SceneLoadOptions& options = SceneLoadOptions());
// Like LoadScene, but adds all errors to `faults` and returns the readable part. image_path is empty if the image is
// missing or has a wrong size, likelihood_path if likelihoods are missing, mesh_path if there is no mesh file.
SceneDescription LoadSceneCollecting(const std::string& path, const SceneLoadOptions& options, Warnings* warnings,
                                     Faults* faults);

// The start mesh in the local frame, not repaired. INVALID_ARGUMENT for a PLY with float coordinates whose rounding
// error exceeds gsd_m / 100 (pass 0 to skip that test). `warnings` (may be null) receives the conversions of unusual
// content, with mesh_path.
StatusOr<TriangleMesh> LoadSceneMesh(const SceneDescription& scene, double gsd_m, Warnings* warnings = nullptr);

// INVALID_ARGUMENT if 32-bit floats round coordinates of size `largest_m` by more than gsd_m / 100.
Status CheckFloatRounding(const std::string& mesh_path, double largest_m, double gsd_m);

// INVALID_ARGUMENT unless `label`, of a face of the scene's mesh at `mesh_path`, is a class of the scene or -1.
// `label_property`: name of the property in the file.
Status CheckFaceLabel(const SceneDescription& scene, const std::string& mesh_path, size_t face, int32_t label,
                      const std::string& label_property);

// How the labels of the mesh at `path` are found: as scene.json says if it is the scene's mesh, else by name.
std::optional<std::string> LabelPropertyOf(const SceneDescription& scene, const std::string& path);

// Median ground sampling distance in metres, over a fixed sample of faces and all views that have the face in their
// frustum and see its front (occlusion is not tested). The GSD of a face is depth / focal length; the angle of
// incidence is ignored. FAILED_PRECONDITION if no view sees any face.
StatusOr<double> MedianGsd(const SceneDescription& scene, const TriangleMesh& mesh);

}  // namespace tessera
