// The mesh of a test's scene, to be edited.
#pragma once

#include <string>

#include "common/geometry/mesh.h"

namespace tessera::bent {

// Of `scene`/mesh.ply. Both abort the test on errors.
TriangleMesh ReadSceneMesh(const std::string& scene);
void WriteSceneMesh(const std::string& scene, const TriangleMesh& mesh);

// Removes the likelihoods' folder and its key.
void DropLikelihoods(const std::string& scene);

}  // namespace tessera::bent
