// Writes blocks as COLMAP's text model, by https://colmap.github.io/format.html.
#pragma once

#include <Eigen/Geometry>
#include <map>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/blocks/block.h"
#include "common/storage/files.h"

namespace tessera {

// Cameras of a block whose lenses are of COLMAP's models, as FULL_OPENCV.
inline Status WriteColmapBlock(const ImportedBlock& block, const std::string& folder) {
  std::string cameras, images, points;
  for (size_t i = 0; i < block.cameras.size(); ++i) {
    const LensModel& lens = block.cameras[i].lens;
    const PinholeCamera& p = lens.pinhole;
    cameras += absl::StrFormat("%d FULL_OPENCV %d %d %.17g %.17g %.17g %.17g", i + 1, p.width, p.height, p.fx, p.fy,
                               p.cx, p.cy);
    for (const double coefficient : lens.coefficients) cameras += absl::StrFormat(" %.17g", coefficient);
    cameras += "\n";
  }
  std::map<std::pair<int, size_t>, size_t> index;  // of the image point, by image and point
  for (size_t i = 0; i < block.images.size(); ++i) {
    const BlockImage& image = block.images[i];
    const Eigen::Quaterniond q(image.rotation_cam_from_block);
    const Eigen::Vector3d t = -(image.rotation_cam_from_block * image.centre);
    images += absl::StrFormat("%d %.17g %.17g %.17g %.17g %.17g %.17g %.17g %d %s\n", i + 1, q.w(), q.x(), q.y(), q.z(),
                              t.x(), t.y(), t.z(), image.camera + 1, image.path);
    size_t count = 0;
    for (size_t k = 0; k < block.points.size(); ++k) {
      for (const BlockObservation& o : block.points[k].observations) {
        if (o.image != static_cast<int>(i)) continue;
        images += absl::StrFormat("%.17g %.17g %d ", o.position_px.x(), o.position_px.y(), k + 1);
        index[{o.image, k}] = count++;
      }
    }
    images += "1.5 2.5 -1\n";  // an image point without a point
  }
  for (size_t k = 0; k < block.points.size(); ++k) {
    const Eigen::Vector3d& x = block.points[k].position;
    points += absl::StrFormat("%d %.17g %.17g %.17g 1 2 3 0.5", k + 1, x.x(), x.y(), x.z());
    for (const BlockObservation& o : block.points[k].observations)
      points += absl::StrCat(" ", o.image + 1, " ", index[{o.image, k}]);
    points += "\n";
  }
  TESSERA_RETURN_IF_ERROR(EnsureFolder(folder));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(folder + "/cameras.txt", cameras));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(folder + "/images.txt", images));
  return WriteFileAtomic(folder + "/points3D.txt", points);
}

}  // namespace tessera
