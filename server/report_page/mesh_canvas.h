// A z-buffer that a mesh is drawn into face by face, so that meshes larger than memory can be drawn.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

#include "common/imaging/camera.h"
#include "common/imaging/raster.h"

namespace tessera {

// What a face carries into the pictures.
struct FaceLook {
  int32_t label = -1;
  float confidence = 0;
  float displacement_m = 0;  // NaN: not known
};

// Faces have one normal each and are visible from both sides. Not thread-safe; Picture uses several threads, and its
// result does not depend on their number. Needs about 140 bytes per pixel of the picture.
class MeshCanvas {
 public:
  // `camera`: of the pictures. `up`: unit vector. Both in the frame of the faces. Light comes from the sky, from a sun
  // to the left of the camera, and from the camera. Ambient occlusion reaches `occlusion_range_m`.
  MeshCanvas(const PosedCamera& camera, const Eigen::Vector3d& up, double occlusion_range_m);

  void Draw(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c, const FaceLook& look);

  // Computes light and occlusion. Call it after the last face, before Picture.
  void Light();

  // RGB, each pixel the mean of four samples. `color`: of a face in [0, 1], called concurrently.
  ByteImage Picture(const std::function<Eigen::Vector3f(const FaceLook&)>& color) const;

 private:
  struct Sample {
    float light = 0;
    Eigen::Vector3f normal = Eigen::Vector3f::Zero();  // camera frame, towards the camera
    FaceLook look;
  };
  float Openness(int x, int y) const;
  Eigen::Vector3f PointAt(int x, int y, float inverse_depth) const;  // camera frame

  PosedCamera camera_;  // of the samples: twice the picture's size
  Eigen::Vector2f principal_;  // the principal point in samples, relative to the centre of the first sample
  Eigen::Vector2f pixel_;      // size of a sample in a plane at a depth of 1
  Eigen::Vector3f up_in_cam_;
  float occlusion_range_m_;
  std::vector<float> inverse_depths_;  // per sample, 1/m; 0: nothing drawn
  std::vector<Sample> samples_;
};

}  // namespace tessera
