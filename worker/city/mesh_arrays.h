// Stores meshes as arrays of a file: NAME.vertices (3 doubles each), NAME.faces (3 indices each), NAME.labels.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "common/arrays/array_file.h"
#include "common/base/status.h"
#include "common/geometry/mesh.h"

namespace tessera {

void PutPoints(const std::vector<Eigen::Vector3d>& points, const std::string& name, ArrayFile* file);
// DATA_LOSS unless there are `count` points (-1: any number).
StatusOr<std::vector<Eigen::Vector3d>> TakePoints(const std::string& name, int64_t count, ArrayFile* file);

void PutMesh(const TriangleMesh& mesh, const std::string& name, ArrayFile* file);
// DATA_LOSS if arrays are missing or inconsistent.
StatusOr<TriangleMesh> TakeMesh(const std::string& name, ArrayFile* file);

}  // namespace tessera
