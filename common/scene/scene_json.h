// scene.json: the file alone, as written.
#ifndef TESSERA_COMMON_SCENE_SCENE_JSON_H_
#define TESSERA_COMMON_SCENE_SCENE_JSON_H_

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/geodesy/frame.h"
#include "common/scene/scene.h"

namespace tessera {

// A file or folder that the scene names, relative to the scene's folder.
struct ScenePath {
  std::string path;
  bool given = false;  // else the default, which may be absent
};

struct FlightEntry {
  Flight flight;
  std::vector<std::string> patterns;  // globs on image names; * also matches '/'
};

struct SceneFile {
  std::string name;
  ScenePath cameras{"colmap"}, images{"images"}, likelihoods{"likelihoods"}, mesh{"mesh.ply"};
  std::string likelihoods_source;   // what they come from, in a scene that a classification left
  std::vector<SceneClass> classes;  // the four known ones unless given
  bool classes_given = false;
  Crs crs;
  std::optional<Eigen::Vector3d> up;  // unit, the scene's frame
  std::vector<FlightEntry> flights;   // one of all images unless given
};

// SceneFile::likelihoods_source of likelihoods that nobody trained for the scene.
inline constexpr const char* kDefaultLikelihoods = "default";

// The known classes of design and paper: ground, facade, roof, vegetation.
const std::vector<SceneClass>& KnownClasses();

// Parses the text of a scene.json; `file` stands for it in messages. Faults: syntax with line and column, unknown keys
// (a typing error would be silently skipped otherwise), values of the wrong type or out of range, each with its key.
SceneFile ParseSceneFile(const std::string& text, const std::string& file, Faults* faults);

}  // namespace tessera

#endif  // TESSERA_COMMON_SCENE_SCENE_JSON_H_
