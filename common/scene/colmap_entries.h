// What COLMAP's text and binary files have in common: each entry is checked here, whatever it was written in.
#ifndef TESSERA_COMMON_SCENE_COLMAP_ENTRIES_H_
#define TESSERA_COMMON_SCENE_COLMAP_ENTRIES_H_

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/scene/colmap.h"

namespace tessera {

struct ColmapCameraModel {
  int id;
  const char* name;
  int parameters;
  bool supported;
};

// All of COLMAP's models (src/colmap/sensor/models.h); null if there is none of that name or number.
const ColmapCameraModel* FindColmapCameraModel(const std::string& name);
const ColmapCameraModel* FindColmapCameraModel(int id);

// A file's name and a place in it.
struct ColmapPlace {
  std::string file;
  std::string place;
  Status Error(const std::string& found, const std::string& expected) const {
    return InputError(file, place, found, expected);
  }
};

// Adds checked entries to a model; faulty ones only leave their fault.
class ColmapBuilder {
 public:
  ColmapBuilder(ColmapModel* model, Faults* faults) : model_(*model), faults_(*faults) {}

  // `model` is null if unknown, `model_name` what the file says.
  void AddCamera(const ColmapPlace& place, uint32_t id, const ColmapCameraModel* model, const std::string& model_name,
                 uint64_t width, uint64_t height, const std::vector<double>& parameters);
  void AddImage(const ColmapPlace& place, ColmapImage image, const double (&quaternion_wxyz)[4]);
  void AddPoint(const ColmapPlace& place, ColmapPoint point);
  // Sorts, and checks what entries say of one another.
  void Finish();

  Faults& faults() { return faults_; }

 private:
  ColmapModel& model_;
  Faults& faults_;
  std::map<uint32_t, std::string> place_of_camera_, place_of_image_;
  std::map<std::string, std::string> place_of_name_;
  std::map<uint64_t, std::string> place_of_point_;
  std::vector<std::pair<ColmapPlace, std::pair<uint32_t, std::string>>> camera_references_;
};

}  // namespace tessera

#endif  // TESSERA_COMMON_SCENE_COLMAP_ENTRIES_H_
