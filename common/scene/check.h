// The whole validation of a scene, pixels and mesh included, and what the user is told about it.
#ifndef TESSERA_COMMON_SCENE_CHECK_H_
#define TESSERA_COMMON_SCENE_CHECK_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/imaging/border_trust.h"
#include "common/scene/coverage.h"
#include "common/scene/scene.h"

namespace tessera {

// Hashes of what a view's files decode to (XXH3-128); empty where it has no such file.
struct PixelContent {
  std::string image, likelihood;
};

// Decodes the view's files: image and likelihoods of so many classes, below `folder`. INVALID_ARGUMENT lists what is
// wrong with either. `borders` (of as many classes; may be null) gets what the two say of each other.
StatusOr<PixelContent> ReadPixelContent(const std::string& folder, const SceneView& view, int classes,
                                        BorderCounts* borders = nullptr);

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
    int64_t observations = 0;   // image points of 3D points
    double median_px = 0;       // of their distances to the projected points
    int64_t track_entries = 0;  // (3D point, image) pairs of the tracks
    double inside_share = 0;    // of the pairs: projected into the image
  };

  std::string name;
  std::string crs;                         // in words
  std::optional<double> lat_deg, lon_deg;  // of the mesh's centre
  std::vector<SizeCount> sizes;
  std::vector<FlightCount> flights;
  int64_t images = 0;
  bool has_likelihoods = false;
  double gsd_m = 0;
  int64_t vertices = 0, faces = 0;
  double surface_m2 = 0;
  double extent_m2 = 0;  // of the box around the mesh, seen along up
  bool has_labels = false;
  std::vector<ClassShare> classes;
  int64_t unlabelled_faces = 0;
  std::vector<PixelContent> contents;  // of each view
  BorderTrusts borders;                // of all views' likelihoods
  // Shares of the faces that were tried (at most 200,000, every n-th): seen by no view, by fewer than three. A view
  // sees a face whose front and centroid nothing hides.
  int64_t faces_tried = 0;
  double unseen_share = 0, under_three_share = 0;
  std::optional<Reprojection> reprojection;  // none if the model has no 3D points
};

// Reads everything that the scene names and reports all faults at once (INVALID_ARGUMENT, one a line), each with its
// file and place. What is odd but usable goes into `warnings`. CANCELLED if `control` says so. Uses all threads; memory
// is bounded by the mesh and one image with its likelihoods a thread.
StatusOr<SceneSummary> CheckScene(const SceneDescription& scene, Warnings* warnings, const TaskControl& control);

// LoadScene and CheckScene in one: faults of both, as far as a scene that is only partly readable lets one go on.
StatusOr<SceneSummary> CheckSceneFolder(const std::string& path, Warnings* warnings, const TaskControl& control);

// The same, loaded so; a mesh of more than `max_mesh_faces` faces is left unread, for others to stream.
StatusOr<SceneSummary> CheckSceneFolder(const std::string& path, const SceneLoadOptions& load, int64_t max_mesh_faces,
                                        Warnings* warnings, const TaskControl& control);

// The fault of a view that sees of the mesh at `mesh_path` what `sight` says; OK if it is good.
Status SightFault(const std::string& mesh_path, const SceneView& view, ViewSight sight);

// INVALID_ARGUMENT if 32-bit floats round coordinates as large as `largest_m` by more than a hundredth of the GSD.
Status CheckFloatRounding(const std::string& mesh_path, double largest_m, double gsd_m);

// A readable table, and the same as JSON with units in the keys.
std::string SummaryToText(const SceneSummary& summary);
std::string SummaryToJson(const SceneSummary& summary, const Warnings& warnings);

}  // namespace tessera

#endif  // TESSERA_COMMON_SCENE_CHECK_H_
