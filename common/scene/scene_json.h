// Parser of scene.json. It does not access the files that scene.json names.
#pragma once

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
  bool given = false;  // false: the default path, which may not exist
};

struct FlightEntry {
  Flight flight;
  std::vector<std::string> patterns;  // globs on image names; * also matches '/'
};

struct SceneFile {
  std::string name;
  ScenePath cameras{"colmap"}, images{"images"}, likelihoods{"likelihoods"}, masks{"masks"}, mesh{"mesh.ply"};
  std::optional<std::string> label_property;  // of the mesh; empty: its labels are ignored; none: found by its name
  std::string likelihoods_source;             // written by tessera classify: "annotations", "model" or "default"
  LikelihoodForm likelihood_form;             // without colours
  std::vector<SceneClass> classes;            // default: KnownClasses()
  bool classes_given = false;
  Crs crs;
  std::optional<SceneSource> source;  // written by tessera import
  std::optional<Eigen::Vector3d> up;  // unit vector, scene coordinates
  std::vector<FlightEntry> flights;   // default: one flight with all images
};

// SceneFile::likelihoods_source of likelihoods from the default rule.
inline constexpr const char* kDefaultLikelihoods = "default";

// The predefined classes, with the priors of the paper: ground, facade, roof, vegetation.
const std::vector<SceneClass>& KnownClasses();

// Parses the text of a scene.json; `file` is its path in messages. Adds to `faults`: syntax errors with line and
// column; unknown keys (else typing errors would be ignored); values of a wrong type or out of range, each with its
// key.
SceneFile ParseSceneFile(const std::string& text, const std::string& file, Faults* faults);

// The JSON texts of `crs` and `source` in scene.json. Reading them gives equal values.
std::string CrsToJson(const Crs& crs);
std::string SceneSourceToJson(const SceneSource& source);

}  // namespace tessera
