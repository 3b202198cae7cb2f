// Checks of COLMAP entries, shared by the text and the binary reader.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/colmap/colmap.h"

namespace tessera {

struct ColmapCameraModel {
  int id;
  const char* name;
  int parameters;
  const char* order;  // of the parameters, if the model is supported; else null
};

// COLMAP's camera model of this name or id (src/colmap/sensor/models.h), supported or not; null if there is none.
const ColmapCameraModel* FindColmapCameraModel(const std::string& name);
const ColmapCameraModel* FindColmapCameraModel(int id);

// A file's name and a location in it.
struct ColmapLocation {
  std::string file;
  std::string location;
  Status Error(const std::string& found, const std::string& expected) const {
    return InputError(file, location, found, expected);
  }
};

// Checks entries and adds them to a model. Invalid entries are reported to `faults` and not added.
class ColmapBuilder {
 public:
  ColmapBuilder(CalibratedImages* model, Faults* faults) : model_(*model), faults_(*faults) {}

  // `model` is null for an unknown camera model; `model_name` is its name in the file. A fault is reported if an image
  // has the camera, or if there are no images.
  void AddCamera(const ColmapLocation& location, uint32_t id, const ColmapCameraModel* model,
                 const std::string& model_name, uint64_t width, uint64_t height, const std::vector<double>& parameters);
  void AddImage(const ColmapLocation& location, CalibratedImage image, const double (&quaternion_wxyz)[4]);
  // The file has more cameras, which cannot be read.
  void OmitsCameras() { omits_cameras_ = true; }
  void AddPoint(const ColmapLocation& location, TiePoint point);
  // Checks references between entries, and sorts the images. Call it once, at the end.
  void Finish();

  Faults& faults() { return faults_; }

 private:
  CalibratedImages& model_;
  Faults& faults_;
  bool omits_cameras_ = false;
  std::map<uint32_t, Status> camera_faults_;  // not yet reported
  std::map<uint32_t, std::string> camera_locations_, image_locations_;
  std::map<std::string, std::string> name_locations_;
  std::map<uint64_t, std::string> point_locations_;
  std::vector<std::pair<ColmapLocation, std::pair<uint32_t, std::string>>> camera_references_;
};

}  // namespace tessera
