// Full validation of a scene, including pixels and mesh, and its summary for users (tessera check).
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/imaging/border_trust.h"
#include "common/scene/coverage.h"
#include "common/scene/fit.h"
#include "common/scene/label_findings.h"
#include "common/scene/scene.h"

namespace tessera {

// XXH3-128 hashes of a view's decoded files; empty if it has no such file.
struct PixelContent {
  std::string image, likelihood;
};

// Decodes the view's image and its likelihoods of `classes` classes, below `folder`. INVALID_ARGUMENT lists the errors
// of both. `borders` (for `classes` classes; may be null) receives the view's border counts, `digest` (may be null)
// that of its likelihoods.
StatusOr<PixelContent> ReadPixelContent(const std::string& folder, const SceneView& view, int classes,
                                        BorderCounts* borders = nullptr, LikelihoodDigest* digest = nullptr);

struct SceneSummary {
  struct SizeCount {
    int width = 0, height = 0;
    int64_t images = 0;
  };
  struct FlightCount {
    Flight flight;
    int64_t images = 0;
  };
  struct ClassShare {
    std::string name;
    int64_t faces = 0;
    double area_share = 0;
  };
  struct Reprojection {
    int64_t observations = 0;   // image points with a 3D point
    double median_px = 0;       // median reprojection error of the image points
    int64_t track_entries = 0;  // (3D point, image) pairs of the tracks
    double inside_share = 0;    // share of the pairs whose 3D point projects into the image
  };

  std::string name;
  std::string crs;                         // for display
  std::optional<double> lat_deg, lon_deg;  // of the mesh's centre; none: not georeferenced
  std::vector<SizeCount> sizes;
  std::vector<FlightCount> flights;
  int64_t images = 0;
  bool has_likelihoods = false;    // false if they are to be ignored (WarnOfLikelihoodValues)
  LikelihoodForm likelihood_form;  // of all likelihood files
  double gsd_m = 0;
  int64_t vertices = 0, faces = 0;
  double surface_m2 = 0;
  double extent_m2 = 0;  // area of the mesh's bounding box in the horizontal plane
  bool has_labels = false;
  std::vector<ClassShare> classes;
  int64_t unlabelled_faces = 0;
  std::vector<PixelContent> contents;  // of each view
  BorderTrusts borders;                // from the likelihoods of all views
  // Shares of the sampled faces (at most 200,000, every n-th) that no view sees, and that fewer than three views see. A
  // view sees a face if its front faces the camera and its centroid is not occluded.
  int64_t faces_tried = 0;
  double unseen_share = 0, under_three_share = 0;
  std::optional<Reprojection> reprojection;  // none if the model has no 3D points
  std::optional<SceneFit> fit;               // none if a file is missing or cannot be read
};

// Loads the scene (LoadScene) and reads all its files. INVALID_ARGUMENT lists all errors, one per line, each with its
// file and location in it; continues with a partly readable scene. Adds unusual but usable input to `warnings`.
// CANCELLED by `control`. Uses all threads; memory is bounded by the mesh plus one image with its likelihoods per
// thread.
StatusOr<SceneSummary> CheckSceneFolder(const std::string& path, Warnings* warnings, const TaskControl& control);

// The same with load options. A mesh of more than `max_mesh_faces` triangles is not loaded; the caller streams it.
StatusOr<SceneSummary> CheckSceneFolder(const std::string& path, const SceneLoadOptions& load, int64_t max_mesh_faces,
                                        Warnings* warnings, const TaskControl& control);

// INVALID_ARGUMENT for a view that sees no face, or mostly backs of faces, of the mesh at `mesh_path`.
Status ViewVisibilityError(const std::string& mesh_path, const SceneView& view, ViewVisibility visibility);

// INVALID_ARGUMENT if 32-bit floats round coordinates of size `largest_m` by more than gsd_m / 100.
Status CheckFloatRounding(const std::string& mesh_path, double largest_m, double gsd_m);

// INVALID_ARGUMENT unless `label`, of a face of the scene's mesh at `mesh_path`, is a class of the scene or -1.
// `label_property`: name of the property in the file.
Status CheckFaceLabel(const SceneDescription& scene, const std::string& mesh_path, size_t face, int32_t label,
                      const std::string& label_property);

// The summary as a table, and as JSON with units in the keys.
std::string SummaryToText(const SceneSummary& summary);
std::string SummaryToJson(const SceneSummary& summary, const Warnings& warnings);

}  // namespace tessera
