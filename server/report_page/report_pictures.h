// Pictures and distributions of a job's result, and pictures of its start mesh.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/geodesy/frame.h"

namespace tessera {

struct ReportClass {
  std::string name;
  std::optional<std::array<uint8_t, 3>> color_rgb;
};

// Shares of equal intervals of low..high, by area. Values outside are counted in the first and the last.
struct Distribution {
  double low = 0, high = 1;
  std::vector<double> shares;
};

struct ReportPictures {
  std::string start_shaded, start_labels;                // JPEG; empty: not drawn
  std::string shaded, labels, displacement, confidence;  // of the result
  int width_px = 0, height_px = 0;                       // of each
  double displacement_range_m = 0;                       // of full colour in `displacement`
  std::optional<Distribution> confidence_shares;         // of faces that an image shows
  std::optional<Distribution> displacement_shares;       // along the normals of the start mesh, outwards positive
  double area_m2 = 0, plan_area_m2 = 0;                  // of the result: surface, and seen from above
  double mean_confidence = 0, unseen_share = 0;          // by area; unseen: confidence 0
  std::vector<ReportClass> classes;                      // with the colours of mesh.ply
  std::string no_start;                                  // why there are no pictures of the start; may be empty
};

struct PictureInputs {
  std::string mesh_path;   // mesh.ply of the job
  std::string start_path;  // the scene's mesh; empty: not known
  std::optional<std::string> start_label_property;
  int64_t start_faces = 0;                        // of the scene's mesh when the job read it
  Frame frame;                                    // of the scene
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();  // local frame, unit vector
  double typical_displacement_m = 0;              // sets the scale of the displacements; 0: they are not shown
  std::vector<ReportClass> classes;
  std::string scratch_folder;  // takes 40 bytes per face of the start mesh
};

// The value of a diverging colour scale, -1 to 1: blue, white, red; and of a scale of confidence, 0 to 1. RGB in [0,
// 1].
Eigen::Vector3f DisplacementShade(float value);
Eigen::Vector3f ConfidenceShade(float value);

// Draws the meshes face by face: memory is bounded by the pictures, for meshes of any size. Pictures show the whole
// result obliquely; a few stray vertices do not shrink it. Without a start mesh, or if it is not that of the job, there
// are only pictures of the result. Deterministic. INVALID_ARGUMENT if mesh.ply is not a result; CANCELLED by `control`.
StatusOr<ReportPictures> DrawReportPictures(const PictureInputs& inputs, const TaskControl& control);

}  // namespace tessera
