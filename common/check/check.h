// Full validation of a scene, including pixels and mesh, and its summary for users (tessera check).
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/check/coverage.h"
#include "common/check/fit.h"
#include "common/check/fit_findings.h"
#include "common/check/inspection.h"
#include "common/check/label_findings.h"
#include "common/check/pixel_content.h"
#include "common/check/tie_points.h"
#include "common/imaging/border_trust.h"
#include "common/scene/scene.h"

namespace tessera {

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
  bool has_likelihoods = false;  // false if they are to be ignored (WarnOfLikelihoodValues)
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
// its likelihoods per thread. `files`: what is known of pixel files that need not be in the folder; the result does not
// depend on it. Errors of its fetch.
StatusOr<CheckedScene> CheckScene(const std::string& path, const SceneLoadOptions& load, int64_t max_mesh_faces,
                                  Warnings* warnings, const TaskControl& control, const InspectedFiles& files = {});

// The summary of CheckScene, with a mesh of any size and default options.
StatusOr<SceneSummary> CheckSceneFolder(const std::string& path, Warnings* warnings, const TaskControl& control);

// The summary as a table, and as JSON with units in the keys. Of a refused scene: its errors and warnings.
std::string SummaryToText(const SceneSummary& summary);
std::string SummaryToJson(const SceneSummary& summary, const Warnings& warnings);
std::string RefusalToJson(const Status& error, const Warnings& warnings);

}  // namespace tessera
