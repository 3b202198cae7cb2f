// A mesh in scratch files, for tests.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>

#include "worker/city/disk_mesh.h"

namespace tessera {

inline DiskMesh ToDisk(const TriangleMesh& mesh) {
  DiskMesh out;
  out.vertices = *ScratchArray<Eigen::Vector3d>::Create(testing::TempDir(), mesh.vertices.size());
  out.faces = *ScratchArray<Triangle>::Create(testing::TempDir(), mesh.faces.size());
  out.labels = *ScratchArray<int32_t>::Create(testing::TempDir(), mesh.labels.size());
  std::copy(mesh.vertices.begin(), mesh.vertices.end(), out.vertices.values().begin());
  std::copy(mesh.faces.begin(), mesh.faces.end(), out.faces.values().begin());
  std::copy(mesh.labels.begin(), mesh.labels.end(), out.labels.values().begin());
  return out;
}

}  // namespace tessera
