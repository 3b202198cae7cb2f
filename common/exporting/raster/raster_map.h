// The coordinate system of exported rasters, and its grid of pixels.
#pragma once

#include <Eigen/Core>
#include <span>
#include <string>

#include "common/base/status.h"
#include "common/exporting/export_format.h"
#include "common/exporting/export_map.h"

namespace tessera {

// What the files say of their coordinate system.
struct RasterSystem {
  // kLocal: a place that no code describes: the scene's own coordinates, or east-north-up of an origin.
  enum class Kind { kLocal, kGeographic, kProjected };
  Kind kind = Kind::kLocal;
  std::string name;                      // for people
  int epsg = 0, vertical_epsg = 0;       // 0: none
  std::string wkt;                       // with the vertical datum; empty for kLocal
  std::string esri_wkt;                  // of the plan, if it has no EPSG code
  double unit_m = 1, height_unit_m = 1;  // metres per unit; unit_m of angles: not used
  bool in_degrees() const { return kind == Kind::kGeographic; }
};

// The map from the local frame to coordinates of a raster (easting or longitude, northing or latitude, height), and the
// size of its pixels. Safe to call concurrently; calls wait for each other.
//
// Pixels are squares of ExportOptions::gsd_m metres of the projection; 0: the scene's GSD, rounded to the nearest of 1,
// 2, 2.5 and 5 times a power of ten, in the system's unit. In degrees, a pixel has about this size at the scene's
// origin, rounded to three digits. Corners of pixels are multiples of the pixel's size in the system, so that all
// rasters of a system fit together.
class RasterMap {
 public:
  // INVALID_ARGUMENT: errors of ExportMap::Open; a geocentric system, with the UTM zone to use instead; a gsd_m that is
  // not between 1/4 and 256 GSD.
  static StatusOr<RasterMap> Open(const ExportScene& scene, const ExportOptions& options);

  // In place. In a local scene, z is up.
  Status FromLocal(std::span<Eigen::Vector3d> points) const;
  Status ToLocal(std::span<Eigen::Vector3d> points) const;

  const RasterSystem& system() const { return system_; }
  // Units of the system, along x and y.
  const Eigen::Vector2d& pixel_size() const { return pixel_size_; }
  // The same in metres, about.
  double pixel_m() const { return pixel_m_; }
  // The height of the local frame's origin.
  double reference_height() const { return reference_height_; }

 private:
  explicit RasterMap(ExportMap map) : map_(std::move(map)) {}
  Status ChoosePixelSize(const ExportScene& scene, double gsd_m);

  ExportMap map_;
  RasterSystem system_;
  Eigen::Vector3d metres_per_coordinate_ = Eigen::Vector3d::Ones();  // of map_'s results, to be divided by
  Eigen::Matrix3d turn_ = Eigen::Matrix3d::Identity();               // of a local scene: takes up to z
  Eigen::Vector2d pixel_size_ = Eigen::Vector2d::Ones();
  double pixel_m_ = 1, reference_height_ = 0;
};

}  // namespace tessera
