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
#include "common/scene/fit_findings.h"
#include "common/scene/label_findings.h"
#include "common/scene/scene.h"
#include "common/scene/tie_points.h"

namespace tessera {

// XXH3-128 hashes of a view's decoded files; empty if it has no such file.
struct PixelContent {
  std::string image, likelihood;
  double masked_share = 0;  // of the photograph's pixels
};

// Decodes the view's image and its likelihoods of `classes` classes, below `folder`. INVALID_ARGUMENT lists the errors
// of both. `borders` (for `classes` classes; may be null) receives the view's border counts, `digest` (may be null) that
// of its likelihoods. `broken` (may be null) receives an error of the image instead; then the content is empty.
StatusOr<PixelContent> ReadPixelContent(const std::string& folder, const SceneView& view, int classes,
                                        BorderCounts* borders = nullptr, LikelihoodDigest* digest = nullptr,
                                        Status* broken = nullptr);

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

  std::string name;
  std::string crs;                         // for display
  std::optional<double> lat_deg, lon_deg;  // of the mesh's centre; none: not georeferenced
  std::vector<SizeCount> sizes;
  std::vector<FlightCount> flights;
  int64_t images = 0;  // used
  std::vector<SkippedImage> skipped;
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
  std::optional<TiePointFigures> tie_points;  // none if the model has no 3D points
  std::optional<SceneFit> fit;                // none if a file is missing or cannot be read
  FitTable fit_table;                         // of `fit`
};

struct CheckedScene {
  SceneDescription scene;  // without the images that are skipped
  SceneSummary summary;
};

// Loads the scene (LoadScene), reads all its files and judges them, for all commands and jobs alike. INVALID_ARGUMENT
// lists the errors, one per line, each with its file and location in it; continues with a partly readable scene. Adds
// unusual but usable input to `warnings` (may be null). A mesh of more than `max_mesh_faces` triangles is not loaded;
// the caller streams it. CANCELLED by `control`. Uses all threads; memory is bounded by the mesh plus one image with
// its likelihoods per thread.
StatusOr<CheckedScene> CheckScene(const std::string& path, const SceneLoadOptions& load, int64_t max_mesh_faces,
                                  Warnings* warnings, const TaskControl& control);

// The summary of CheckScene, with a mesh of any size and default options.
StatusOr<SceneSummary> CheckSceneFolder(const std::string& path, Warnings* warnings, const TaskControl& control);

// INVALID_ARGUMENT if 32-bit floats round coordinates of size `largest_m` by more than gsd_m / 100.
Status CheckFloatRounding(const std::string& mesh_path, double largest_m, double gsd_m);

// INVALID_ARGUMENT unless `label`, of a face of the scene's mesh at `mesh_path`, is a class of the scene or -1.
// `label_property`: name of the property in the file.
Status CheckFaceLabel(const SceneDescription& scene, const std::string& mesh_path, size_t face, int32_t label,
                      const std::string& label_property);

// The summary as a table, and as JSON with units in the keys. Of a refused scene: its errors and warnings.
std::string SummaryToText(const SceneSummary& summary);
std::string SummaryToJson(const SceneSummary& summary, const Warnings& warnings);
std::string RefusalToJson(const Status& error, const Warnings& warnings);

}  // namespace tessera
