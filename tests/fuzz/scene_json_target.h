// scene.json.
#pragma once

#include <cmath>
#include <string>

#include "common/scene/scene_json.h"
#include "tests/fuzz/promises.h"

namespace tessera {

// True if it was taken as a scene.
inline bool RunSceneJsonTarget(const std::string& bytes) {
  Faults faults;
  const SceneFile scene = ParseSceneFile(bytes, "scene.json", &faults);
  if (!Accepted(faults)) return false;
  Require(!scene.classes.empty() && !scene.flights.empty(), "a scene has classes and flights");
  for (const SceneClass& each : scene.classes) {
    Require(std::isfinite(each.prior_alpha_rad) && std::isfinite(each.prior_beta_rad) && std::isfinite(each.smoothness),
            "numbers are finite");
  }
  if (scene.up) Require(std::abs(scene.up->norm() - 1) < 1e-6, "up is a unit vector");
  return true;
}

}  // namespace tessera
