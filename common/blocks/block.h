// Blocks of other programs: photographs with cameras, poses and tie points, as every reader of a program's files
// returns them.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "common/imaging/camera.h"

namespace tessera {

// A camera with its lens, in the conventions of LensModel: pixels, the centre of the first pixel is (0.5, 0.5).
struct BlockCamera {
  std::string name;
  LensModel lens;
};

struct BlockImage {
  std::string path;      // of its file, as the source has it; may be a path of another machine, such as D:\a\b.jpg
  std::string location;  // of its entry in the source, for messages
  int camera = -1;       // index into ImportedBlock::cameras
  int component = 0;     // images of one component were adjusted together
  // The pose, if the source has one. x_cam = rotation_cam_from_block (X_block - centre); the camera's x points right,
  // y down, z forward. `centre` is in the coordinates of the block, without ImportedBlock::offset.
  bool oriented = true;
  Eigen::Matrix3d rotation_cam_from_block = Eigen::Matrix3d::Identity();
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
};

struct BlockObservation {
  int image = -1;                                         // index into ImportedBlock::images
  Eigen::Vector2d position_px = Eigen::Vector2d::Zero();  // in the distorted photograph
};

struct BlockTiePoint {
  // Coordinates of the block, without offset. Zero: the source has none; the proof triangulates the point.
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  std::vector<BlockObservation> observations;
};

struct ImportedBlock;

// Another reading of the same file: a convention that differs between programs or versions and that the file does not
// state. The proof tries each on the tie points.
struct BlockReading {
  std::string name;  // for messages, such as "VisualSFM's positions from the middle of the image"
  std::function<void(ImportedBlock*)> apply;
};

struct ImportedBlock {
  std::string format;              // BlockFormat::name
  std::string version;             // of the format, as the file states it; may be empty
  std::vector<std::string> files;  // all files that were read, absolute

  std::vector<BlockCamera> cameras;
  std::vector<BlockImage> images;
  // Paths of images that were left out, each with a fault: their file alone states their size, and was not found.
  std::vector<std::string> missing_images;
  std::vector<BlockTiePoint> points;
  std::vector<BlockTiePoint> control_points;  // surveyed; they are proof too, but no tie points of the scene

  // The coordinate reference system of positions, as PROJ reads it: "EPSG:2154", "EPSG:32632+5773", WKT; or
  // "ENU:LAT,LON[,H]" (degrees, metres, WGS 84). Empty: the source names none. Coordinates are (easting or longitude,
  // northing or latitude, height) in this order whatever the axes of the system are, in its units; geocentric ones are
  // (x, y, z).
  std::string crs;
  // The system in which the program writes meshes, if it is another than `crs`; else empty.
  std::string mesh_crs;
  // Added to positions of the block to get coordinates of the reference system. For formats that shift coordinates.
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
  // The program adjusted in a map projection as if it were Cartesian (Pix4D).
  bool adjusted_in_grid = false;

  std::vector<BlockReading> readings;    // tried by the proof; may be empty
  std::vector<std::string> conventions;  // what the reader applied, a sentence each; go to import.json
  std::vector<std::string> left_out;     // what the reader did not read, with the reason and the number
};

}  // namespace tessera
